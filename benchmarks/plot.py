"""Figures of a benchmark's record as SVG: ``python -m benchmarks.plot RECORD.json FOLDER``."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from commonrail.base.errors import CommonrailError
from commonrail.runs.folder import read_record

COLOURS = {"lanes": "#1b5e8c", "reference": "#6f9bb8", "SciPy": "#c77f2d", "SUNDIALS": "#8c3b2a"}
STYLE: Any = {
    "svg.hashsalt": "commonrail",
    "svg.fonttype": "none",
    "font.size": 9,
    "axes.grid": True,
    "grid.alpha": 0.3,
}
Row = dict[str, Any]


def draw_methods(record: Row) -> Figure:
    """Bars of time for one simulation next to bars of its L1 error, fastest first."""
    rows = sorted((r for r in record["methods"] if r["L1_percent"] is not None), key=lambda r: -r["seconds"])
    figure, (left, right) = plt.subplots(1, 2, sharey=True, figsize=(9.5, 0.27 * len(rows) + 1.4))
    names, colours = [r["method"] for r in rows], [COLOURS[r["family"]] for r in rows]
    for axes, values, label in (
        (left, [1e3 * r["seconds"] for r in rows], "one simulation, ms"),
        (right, [r["L1_percent"] for r in rows], "L1 error of the rate, %"),
    ):
        axes.barh(names, values, color=colours, log=True)
        axes.set_xlabel(label)
        axes.grid(axis="y", visible=False)
    figure.suptitle(_title(record), fontsize=8)
    return figure


def draw_costs(record: Row) -> Figure:
    """Time and memory against candidates, operating points, horizon and threads."""
    figure, grid = plt.subplots(2, 3, figsize=(9.5, 5.4))
    axes = grid.ravel()
    alive = [r for r in record["candidates"] if "failed" not in r]
    _curve(axes[0], alive, "candidates", "seconds", "candidates", "s", log="xy")
    _curve(axes[1], alive, "candidates", "per_second", "candidates", "simulations per second", log="xy")
    _curve(axes[2], alive, "candidates", "peak_bytes", "candidates", "greatest memory, MB", log="x", scale=1e-6)
    _curve(axes[3], record["points"], "points", "seconds", "operating points, 512 candidates", "s")
    _curve(axes[4], record["horizon"], "horizon", "seconds", "horizon, s, 512 candidates", "s")
    _curve(axes[5], record["threads"], "threads", "per_second", "threads", "simulations per second")
    figure.suptitle(_title(record), fontsize=8)
    return figure


def _curve(
    axes: Axes, rows: list[Row], x: str, y: str, across: str, up: str, *, log: str = "", scale: float = 1.0
) -> None:
    measured = [r for r in rows if r[y] is not None]
    axes.plot([r[x] for r in measured], [scale * r[y] for r in measured], "o-", color=COLOURS["lanes"])
    axes.set_xlabel(across)
    axes.set_ylabel(up)
    if "x" in log:
        axes.set_xscale("log")
    if "y" in log:
        axes.set_yscale("log")
    else:
        axes.set_ylim(bottom=0.0)


def _title(record: Row) -> str:
    machine = record["machine"]
    measured = f"{machine['processor']}, {machine['threads']} threads, {record['date'][:10]}"
    return "\n".join([f"SYNTHETIC case {record['case']}", measured, *record["notes"]])


FIGURES: dict[str, tuple[tuple[str, ...], Callable[[Row], Figure]]] = {
    "bench-methods.svg": (("methods",), draw_methods),
    "bench-costs.svg": (("candidates", "points", "horizon", "threads"), draw_costs),
}


def draw(record: Row, folder: Path) -> list[Path]:
    """Draw what the record holds and return the files."""
    drawn = []
    with plt.rc_context(STYLE):
        for name, (needed, make) in FIGURES.items():
            if not all(record.get(key) for key in needed):
                continue
            figure = make(record)
            figure.tight_layout()
            figure.savefig(folder / name, metadata={"Date": None}, bbox_inches="tight")
            plt.close(figure)
            drawn.append(folder / name)
    return drawn


def main() -> None:
    """Draw into a folder."""
    if len(sys.argv) != 3:
        sys.exit("usage: python -m benchmarks.plot RECORD.json FOLDER")
    try:
        record = read_record(Path(sys.argv[1]), "python -m benchmarks speed")
    except CommonrailError as error:
        sys.exit(str(error))
    print(*draw(record, Path(sys.argv[2])), sep="\n")


if __name__ == "__main__":
    main()
