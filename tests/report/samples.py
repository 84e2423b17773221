"""Records as result.json holds them, made up."""

from __future__ import annotations

from typing import Any

import numpy as np

from commonrail.calibration.record import CalibrationRecord, read_as
from commonrail.data.records import LABELS

TABLE_1 = {  # theoretical and optimal stiffness [N/m], Table 1 of the paper
    "k1": (1.22e8, 3.03e8),
    "k2": (8.08e7, 8.26e7),
    "k3": (8.21e7, 8.35e7),
    "k4": (9.44e7, 1.41e8),
    "k5": (9.43e7, 1.05e8),
    "k6": (1.86e8, 3.72e8),
    "k7": (5.82e7, 6.44e7),
}
VERDICTS = ("determined", "only in combination", "insensitive")
SYNTHETIC = "Curves of a virtual test bench, not measurements."

MAP = {  # rail pressure [MPa] → quantity [mm³] at each energising time [us]
    40: (0.24, 0.75, 2.05, 4.20, 10.97, 24.96, 45.12),
    80: (0.67, 2.32, 5.28, 10.47, 26.31, 51.76, 86.30),
    160: (1.87, 5.83, 13.69, 26.06, 52.43, 92.76, 148.31),
}
DURATIONS = (250, 300, 400, 500, 700, 1000, 1400)
DEAD_TIMES = {40: 282, 80: 240, 160: 228}


def fit_of(record: dict[str, Any]) -> CalibrationRecord:
    """Record as reports read it."""
    return read_as(CalibrationRecord, record)


def rate_record() -> dict[str, Any]:
    """Three curves, one to fit; all of it synthetic."""
    record = _record("Stiffness of the plunger and needle")
    record["synthetic"] = SYNTHETIC
    record["constraints"] = ["plunger_needle.k7 < plunger_needle.k2 < plunger_needle.k3"]
    record["parameters"] = [_stiffness(i, *item) for i, item in enumerate(TABLE_1.items())]
    record["data"] = [
        _rate("EVI 160 MPa", "fit", 160e6, (931.4, 402.2, 171.5)),
        _rate("EVI 120 MPa", "validation", 120e6, (822.0, 355.1, 160.2)),
        _rate("EVI 80 MPa", "validation", 80e6, (611.7, 291.0, 158.4)),
    ]
    return record


def rate_traces(record: dict[str, Any]) -> dict[str, dict[str, np.ndarray]]:
    """Trapezoids with noise, 520 samples 3 us apart [s, m³/s]."""
    rng = np.random.default_rng(1)
    time = 3e-6 * (np.arange(520) + 0.5)
    traces = {}
    for d in record["data"]:
        peak = 52e-6 * np.sqrt(d["rail_pressure"] / 160e6)
        traces[d["name"]] = {
            "time_s": time,
            "measured": _pulse(time, 0, peak) + rng.normal(0.0, 0.3e-6, len(time)),
            "rigid": _pulse(time, 45e-6, 0.93 * peak),
            "start": _pulse(time, 14e-6, 0.98 * peak),
            "best": _pulse(time, 2e-6, peak),
        }
    return traces


def map_record() -> dict[str, Any]:
    """A measured map with dead times, and one pressure for validation."""
    record = _record("Quantity map of a servo injector")
    record["parameters"] = [_stiffness(i, *item) for i, item in enumerate(TABLE_1.items())][:3]
    record["data"] = [_map("map", "fit", (40, 160)), _map("map at 80 MPa", "validation", (80,))]
    return record


def _record(title: str) -> dict[str, Any]:
    steps = np.arange(51)
    return {
        "schema": 1,
        "kind": "calibration",
        "software": {
            "commonrail": "0.1.0",
            "python": "3.11.7",
            "numpy": "2.1.0",
            "numba": "0.60.0",
        },
        "title": title,
        "note": "A note of the study.",
        "synthetic": "",
        "seed": 7,
        "time_step": 1e-6,
        "precision": "f64",
        "same_bits": False,
        "optimiser": {"method": "differential evolution", "generations": 70, "members": 50, "polish": 0},
        "labels": dict(LABELS),
        "warnings": [],
        "status": "finished",
        "reason": "the last generation was reached",
        "injector": {
            "name": "virtual",
            "title": "Virtual injector",
            "variant": "flexible body, ideal rail, pwm drive",
        },
        "constraints": [],
        "objective": {"start": 402.2, "best": 171.5},
        "evaluations": {"slots": 3550, "simulated": 3211, "failed": 4, "injections": 3211},
        "generations": [
            {
                "generation": int(g),
                "best": 170.0 + 400.0 * float(np.exp(-g / 6)),
                "mean": 175.0 + 1500.0 * float(np.exp(-g / 9)),
            }
            for g in steps
        ],
        "clock": {"seconds": 83.2, "simulations_per_second": 38.6, "ended": "2024-05-06T07:08:09+00:00"},
    }


def _stiffness(index: int, name: str, values: tuple[float, float]) -> dict[str, Any]:
    start, best = values
    position = (best / start - 0.1) / 1.9
    return {
        "name": f"plunger_needle.{name}",
        "unit": "N/m",
        "meaning": f"stiffness of cylinder {name[1]}",
        "reference": start,
        "lower": 0.1 * start,
        "upper": max(2.0 * start, best),
        "best": best,
        "mark": "F",
        "source": "Eq. (8) from the drawing",
        "position": min(position, 1.0),
        "at_bound": position > 0.99,
        "effect": 4.1 / (index + 1),
        "pinned": 1.2 / (index + 1),
        "standard_error": 0.03 * best,
        "verdict": VERDICTS[index % 3],
    }


def _rate(name: str, role: str, rail: float, j: tuple[float, ...]) -> dict[str, Any]:
    by_label = dict(zip(("rigid", "start", "best"), j, strict=True))
    return {
        "name": name,
        "kind": "rate",
        "role": role,
        "source": "virtual test bench, seed 1",
        "synthetic": SYNTHETIC,
        "samples": 520,
        "rail_pressure": rail,
        "energising_time": 7e-4,
        "J": by_label,
        "J_relative": {label: value / 14000.0 for label, value in by_label.items()},
        "volume": {"measured": 51.7e-9, "rigid": 38.2e-9, "start": 53.8e-9, "best": 51.9e-9},
    }


def _map(name: str, role: str, rails: tuple[int, ...]) -> dict[str, Any]:
    rows = []
    for rail in rails:
        for i, (duration, quantity) in enumerate(zip(DURATIONS, MAP[rail], strict=True)):
            measured = quantity * 1e-9
            rows.append(
                {
                    "rail_pressure": rail * 1e6,
                    "energising_time": duration * 1e-6,
                    "dead_time": False,
                    "measured": measured,
                    "start": measured * (0.7 + 0.04 * i),
                    "best": measured * (1.0 + 0.15 * (-1) ** i / (i + 1)) + 0.1e-9,
                }
            )
        dead = DEAD_TIMES[rail] * 1e-6
        rows.append(
            {
                "rail_pressure": rail * 1e6,
                "energising_time": dead,
                "dead_time": True,
                "quantity": 0.5e-9,
                "measured": dead,
                "start": dead + 31e-6,
                "best": dead - 4e-6,
            }
        )
    figures = {
        label: {
            "rms_small": small,
            "rms_large_percent": large,
            "dead_time_rms": dead,
            "limit_quantity": 3e-9,
        }
        for label, small, large, dead in (
            ("start", 0.61e-9, 22.4, 31e-6),
            ("best", 0.21e-9, 4.83, 4e-6),
        )
    }
    return {
        "name": name,
        "kind": "quantities",
        "role": role,
        "source": "github.com/suertang/AI_ETMAP, commit b3a8019, map 165",
        "synthetic": "",
        "rows": rows,
        "figures": figures,
    }


def _pulse(time: np.ndarray, late: float, peak: float) -> np.ndarray:
    """Trapezoid from 0.22 to 1.3 ms, `late` at both ends [s]."""
    corners = [0.22e-3 + late, 0.45e-3 + late, 0.95e-3 - late, 1.3e-3 - late]
    return np.asarray(np.interp(time, corners, [0.0, peak, peak, 0.0]))
