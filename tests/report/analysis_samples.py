"""Records of a sensitivity study and of a tolerance study, made up by hand."""

from __future__ import annotations

from typing import Any


def _interval(value: float, reach: float) -> dict[str, float]:
    return {"value": value, "low": value - reach, "high": value + reach}


def _ranked(name: str, total: float, ends: tuple[float | None, float | None]) -> dict[str, Any]:
    low, high = ends
    swing = None if low is None or high is None else high - low
    row = {"name": name, "low": low, "high": high, "swing": swing, "used": 64}
    return row | {"first": _interval(total - 0.01, 0.1), "total": _interval(total, 0.1)}


def sensitivity_record() -> dict[str, Any]:
    """Two parameters; an output whose figures are there, and one that has none."""
    ranges = [
        {"name": name, "unit": unit, "reference": 2.0 * low, "lower": low, "upper": 3.0 * low}
        | {"scale": "linear", "mark": "E", "source": "made up"}
        for name, unit, low in (("nozzle.hole_diameter", "m", 65e-6), ("valve.spring_preload", "N", 36.0))
    ]
    quantity = {
        "name": "quantity",
        "unit": "m3",
        "meaning": "injected quantity",
        "point": "160 MPa, 700 us",
        "base": 50e-9,
        "missing": "",
        "failed": {"number": 0, "share": 0.0, "reasons": {}, "where": ""},
        "estimated": True,
        "why_not": "",
        "mean": 51e-9,
        "variance": 4e-18,
        "parameters": [
            _ranked("nozzle.hole_diameter", 0.9, (45e-9, 56e-9)),
            _ranked("valve.spring_preload", 0.005, (50.5e-9, 49.6e-9)),
        ],
    }
    bare = [{"name": r["name"], "low": None, "high": None, "swing": None} for r in ranges]
    delay = quantity | {
        "name": "opening_delay",
        "unit": "s",
        "meaning": "hydraulic delay",
        "base": None,
        "missing": "The needle does not open, or does not close.",
        "failed": {
            "number": 200,
            "share": 0.78125,
            "reasons": {"The needle does not open, or does not close.": 200},
            "where": "high valve.spring_preload",
        },
        "estimated": False,
        "why_not": "78.1% of the simulations have no value, more than the 10% up to which indices are given.",
        "mean": None,
        "variance": None,
        "parameters": bare,
    }
    return {
        "schema": 1,
        "kind": "sensitivity",
        "software": {"commonrail": "0.1.0"},
        "target": "made up",
        "title": "made-up injector",
        "injector": "made-up",
        "synthetic": "All of it is made up.",
        "design": "sobol",
        "samples": 64,
        "seed": 1,
        "resamples": 1000,
        "confidence": 0.95,
        "on_failure": "omit",
        "most_failed": 0.1,
        "precision": "f64",
        "notes": [],
        "ranges": ranges,
        "outputs": [quantity, delay],
        "injections": 261,
        "clock": {"seconds": 0.5},
    }


def _spread(deviation: float, below: int) -> dict[str, Any]:
    return {
        "parts": 10_000,
        "failed": 3,
        "reasons": {"A made-up reason.": 3},
        "mean": 50.1e-9,
        "deviation": deviation,
        "quantiles": {
            share: 50e-9 + k * deviation
            for share, k in (("0.00135", -3), ("0.025", -2), ("0.5", 0), ("0.975", 2), ("0.99865", 3))
        },
        "lower": 48e-9,
        "upper": None,
        "below": below,
        "above": 0,
        "out": _interval((below + 3) / 10_000, 2e-4),
        "cp": None,
        "cpk": 1.05,
        "histogram": {"edges": [48e-9, 49e-9, 50e-9, 52e-9], "counts": [1000, 3000, 5997]},
    }


def tolerance_record() -> dict[str, Any]:
    """Two dimensions at one point, with a trim."""
    point = {
        "name": "full load",
        "rail_pressure": 160e6,
        "energisings": [{"start": 0.0, "duration": 700e-6}],
        "nominal": 50e-9,
        "spread": _spread(0.7e-9, 57),
        "dimensions": [
            {"name": "nozzle.hole_diameter", "share": _interval(0.9, 0.01), "swing": 2e-9, "if_halved": 0.4e-9},
            {"name": "valve.lift", "share": None, "swing": None, "if_halved": None},
        ],
        "rest": 0.02,
    }
    laws = ({"kind": "normal", "mean": 130e-6, "sigma": 1e-6, "lower": None, "upper": None},)
    laws += ({"kind": "uniform", "lower": 50e-6, "upper": 60e-6},)  # type: ignore[assignment]
    dimensions = [
        {"name": name, "unit": "m", "drawn": drawn, "distribution": law, "mark": "E", "source": "made up"}
        for name, drawn, law in zip(("nozzle.hole_diameter", "valve.lift"), (130e-6, 55e-6), laws, strict=True)
    ]
    trimmed = {"name": "full load", "before": _spread(0.7e-9, 57), "after": _spread(0.1e-9, 0)}
    return {
        "schema": 1,
        "kind": "tolerance",
        "software": {"commonrail": "0.1.0"},
        "target": "made up",
        "title": "made-up tolerances",
        "synthetic": "All of it is made up.",
        "injector": {"name": "made-up", "title": "made-up injector", "variant": "rigid"},
        "status": "complete",
        "asked": 10_000,
        "parts": 10_000,
        "injections": 18_194,
        "seed": 1,
        "sampling": "quasi-random",
        "time_step": 1e-6,
        "precision": "f64",
        "confidence": 0.95,
        "dimensions": dimensions,
        "correlations": [{"first": "nozzle.hole_diameter", "second": "valve.lift", "value": 0.3}],
        "points": [point],
        "trim": {
            "test_points": ["full load"],
            "parts": 8190,
            "unmeasured": 2,
            "resolution": 1e-6,
            "scatter": 1e-10,
            "slopes": [8e-5],
            "points": [trimmed | {"correction": {"mean": 0.0, "deviation": 9e-6}, "held": 1}],
        },
        "clock": {"seconds": 2.0},
    }
