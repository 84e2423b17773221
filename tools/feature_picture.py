"""Picture of the features of a pilot and a main injection: ``python -m tools.feature_picture FILE.svg``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes

import commonrail as cr

POINT = cr.OperatingPoint("160 MPa", [("0 us", "200 us"), ("900 us", "500 us")], horizon="3 ms")
STYLE: Any = {"svg.hashsalt": "commonrail", "svg.fonttype": "none", "font.size": 8}
NARROW = 300.0  # duration below which the text is above the curve [us]
RATE, MARK, LEVEL = "#1b5e8c", "#c1272d", "#6b7785"


def draw(path: Path) -> None:
    """Simulate both injections and draw their rates with the detected features."""
    trace = cr.simulate(cr.load_injector("virtual-lino-2016"), POINT)
    features = cr.features.find_features(trace, POINT)
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(figsize=(7.2, 3.2))
        axes.plot(trace.rate_time * 1e6, trace.rate_mm3_per_ms, color=RATE, linewidth=1.4)
        level = features.levels.threshold * 1e6
        axes.axhline(level, color=LEVEL, linestyle=":", linewidth=1.0)
        axes.text(2250.0, level + 1.0, f"threshold, 10 % = {level:.1f} mm³/ms", color=LEVEL, ha="right")
        for number, pulse in enumerate(POINT.pulses, start=1):
            injection = features.of(number)
            assert injection is not None
            annotate(axes, number, injection, pulse, level)
        for other in features.injections:
            if other.energising is None:
                place = 1e6 * other["closing"], 1e6 * other["peak_rate"]
                axes.text(*place, f"  reopened: {1e9 * other['quantity']:.2f} mm³", color=MARK)
        axes.set(xlim=(-50.0, 2300.0), ylim=(-11.0, None), xlabel="time, µs", ylabel="rate, mm³/ms")
        axes.spines[["top", "right"]].set_visible(False)
        figure.tight_layout()
        figure.savefig(path, metadata={"Date": None})


def annotate(axes: Axes, number: int, injection: cr.features.Injection, pulse: cr.Energising, level: float) -> None:
    """Mark energising, opening, closing, delays, peak and quantity of one injection."""
    start, end = 1e6 * pulse.start, 1e6 * (pulse.start + pulse.duration)
    axes.plot([start, end], [-3.0, -3.0], color="black", linewidth=4.0, solid_capstyle="butt")
    opening, closing = 1e6 * injection["opening"], 1e6 * injection["closing"]
    axes.plot([opening, closing], [level, level], "o", color=MARK, markersize=3.5)
    for begin, to, height in ((start, opening, -6.0), (end, closing, -9.0)):
        axes.annotate(
            "", (to, height), (begin, height), arrowprops={"arrowstyle": "<->", "color": MARK, "linewidth": 0.8}
        )
    peak = 1e6 * injection["peak_rate"]
    axes.text(
        0.5 * (opening + closing),
        peak + 9.0 if closing - opening < NARROW else 0.45 * peak,
        f"{number}: {1e9 * injection['quantity']:.2f} mm³\n{1e6 * injection['duration']:.0f} µs\n"
        f"delays {1e6 * injection['opening_delay']:.0f}, {1e6 * injection['closing_delay']:.0f} µs",
        ha="center",
        va="center",
    )


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python -m tools.feature_picture FILE.svg")
    draw(Path(sys.argv[1]))
