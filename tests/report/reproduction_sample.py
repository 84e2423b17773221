"""A record and curves of a reproduction, made up for the tests: two seeds, few samples."""

from __future__ import annotations

from typing import Any

import numpy as np

from commonrail.base.record import from_record
from commonrail.plugins.paper.file import ReproductionSummary

LABELS = {
    "rigid": "rigid body",
    "rigid_fitted": "rigid body, fitted",
    "theoretical": "theoretical",
    "paper": "paper's optimal k",
    "optimised": "optimised",
}
DATA = ("160 MPa", "120 MPa", "80 MPa")
SEEDS = [4, 7]
CONFIGURATIONS = ((50, 30), (50, 70), (70, 50))


def three(median: float | None) -> dict[str, float | None]:
    """Median and quartiles."""
    if median is None:
        return {"median": None, "q1": None, "q3": None}
    return {"median": median, "q1": 0.9 * median, "q3": 1.1 * median}


def by_data(value: float) -> dict[str, float]:
    return {name: value + i for i, name in enumerate((*DATA, "mean"))}


def claim(name: str, verdict: str, comment: str = "", chance: float | None = None) -> dict[str, Any]:
    return {
        "chance": chance,
        "id": name,
        "claim": f"The claim {name} & <more>.",
        "where": "Sec. 5",
        "measure": "what is measured",
        "figure": f"figure of {name}",
        "verdict": verdict,
        "true_in": 2,
        "of": 2,
        "interval": [0.158, 1.0],
        "comment": comment,
    }


def record() -> dict[str, Any]:
    """As `reproduction_record` makes it."""
    box = {"minimum": 0.5, "q1": 0.8, "median": 1.0, "q3": 1.2, "maximum": 1.9}
    return {
        "schema": 1,
        "kind": "reproduction",
        "software": {"commonrail": "0.1.0", "python": "3.11"},
        "title": "A sample of a reproduction",
        "status": "finished",
        "quick": False,
        "seeds": SEEDS,
        "asked": 2,
        "time_step": 1e-6,
        "synthetic": "All of it is made up for a test.",
        "truth": {"title": "A truth of the tests", "facts": [["noise", "0.3 mm3/ms [E]"]]},
        "data": [
            {
                "name": name,
                "role": "validation" if i else "fit",
                "rail_pressure": (160 - 40 * i) * 1e6,
                "energising_time": 7e-4,
                "samples": 4,
            }
            for i, name in enumerate(DATA)
        ],
        "labels": LABELS,
        "J": {name: {k: [100.0, 110.0] for k in LABELS} for name in DATA},
        "J_spread": {name: {k: three(1000.0 + i) for i, k in enumerate(LABELS)} for name in DATA},
        "table1": [
            {
                "name": f"plunger_needle.k{i}",
                "symbol": f"k{i}",
                "unit": "N/m",
                "theoretical": 1e8 * i,
                "paper": 1.5e8 * i,
                "lower": 1e7,
                "upper": 3e8,
                "values": [1.1e8 * i, 1.3e8 * i],
                **three(1.234e8 * i),
                "paper_change": 0.5,
                "change": three(-0.25),
                "verdicts": {"only in combination": 1, "not confirmed": 1} if i == 7 else {"determined": 2},
                "truth": 1.2e8 * i,
                "covered": 0 if i == 7 else 2,
                "intervals": 2,
                "standard_error": None if i == 7 else 5.5e6,
            }
            for i in range(1, 8)
        ],
        "meter": [
            {
                "label": label,
                "text": text,
                "J": {name: three(200.0 + i) for i, name in enumerate(DATA)},
                "stiffness": {f"k{i}": {"values": [6e7, 6.1e7], **three(6.05e7)} for i in range(1, 8)},
                "delay": three(5.3e-6) if label == "delay" else None,
            }
            for label, text in (("none", "no meter"), ("known", "a known meter"), ("delay", "a fitted delay"))
        ],
        "rigid_fit": [
            {
                "name": "plunger_needle.stop_lift",
                "unit": "m",
                "meaning": "lift of the stop",
                "drawing": 1e-4,
                "lower": 1e-5,
                "upper": 1e-3,
                "values": [2e-4, 2.2e-4],
                **three(2.12e-4),
            },
            {
                "name": "control_chamber.volume",
                "unit": "m3",
                "meaning": "volume of the control chamber",
                "drawing": 1.8e-8,
                "lower": 1.8e-9,
                "upper": 1.8e-7,
                "values": [5e-8, 5e-8],
                **three(5e-8),
            },
        ],
        "table3": [
            {
                "generations": g,
                "members": n,
                "slots": (g + 1) * n,
                "simulated": [(g + 1) * n] * 2,
                "J": {name: [150.0, 160.0] for name in DATA},
                "mean": [150.0, 160.0],
                **{key: by_data(150.0 + g / 10 - n / 10) for key in ("median", "q1", "q3")},
                "paper": by_data(166.25),
                "note": "the paper's choice" if (g, n) == (70, 50) else "",
            }
            for g, n in CONFIGURATIONS
        ],
        "treatments": [
            {
                "name": name,
                "text": f"treatment {name}",
                "slots": 3550,
                "simulated": [3550, 3550],
                "share": three(share),
                "J": [j, j],
                **three(j),
            }
            for name, share, j in (("repair", 1.0, 155.0), ("literal", 0.0013, None))
        ],
        "convergence": {
            "generation": [0, 1, 2],
            "best": {"median": [300.0, 200.0, 156.0], "low": [280.0, 190.0, 150.0], "high": [320.0, 210.0, 160.0]},
            "mean": {"median": [2000.0, 500.0, 160.0], "low": [1900.0, 450.0, 155.0], "high": [2100.0, 550.0, None]},
            "level": {"median": 830.0},
            "ninety": [1.0, 2.0],
        },
        "search": [
            {"symbol": f"k{i}", "seed": box, "all": box, "lower": 0.1, "upper": 3.0, "paper": 1.5} for i in range(1, 8)
        ],
        "phases": {
            "names": ["before opening", "0–0.4 ms", "0.4–0.8 ms", "0.8 ms to the end"],
            "J": {},
            "median": {name: {k: [1.0, 2.0, 3.0, 4.0] for k in LABELS} for name in DATA},
        },
        "edges": {name: {k: {"opening": three(-9.35e-5), "closing": three(None)} for k in LABELS} for name in DATA},
        "overfitting": {
            name: {key: three(300.0) for key in ("fitted_there", "fitted_at_160", "theoretical")}
            | {"gain_kept": three(0.78)}
            for name in DATA[1:]
        },
        "claims": [
            claim("one", "holds", chance=0.914),
            claim("two", "does not hold", "A comment."),
            claim("three", "cannot be told"),
            claim("four", "holds"),
        ],
        "shown_seed": 4,
        "seconds": 12.5,
        "simulations": 123456,
    }


def summary() -> ReproductionSummary:
    """The record as a typed object."""
    return from_record(ReproductionSummary, record())


def traces() -> dict[int, dict[str, dict[str, np.ndarray]]]:
    """By seed and data set; one simulation failed."""
    time = np.array([1.5e-6, 4.5e-6, 7.5e-6, 10.5e-6])
    rate = np.array([0.0, 2e-5, 3e-5, 0.0])
    curves = {"time_s": time, "experiment": rate} | {k: rate * (1.0 + 0.1 * i) for i, k in enumerate(LABELS)}
    found = {seed: {name: {k: v.copy() for k, v in curves.items()} for name in DATA} for seed in SEEDS}
    found[4]["80 MPa"]["rigid"][:] = np.nan
    return found
