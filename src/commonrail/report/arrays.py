"""Values of results as named arrays in the units that engineers use, for pandas and xarray."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from commonrail.analysis.certainty.certify import Certainty
from commonrail.analysis.design.next import Plan
from commonrail.analysis.posterior.sample import Posterior
from commonrail.analysis.prediction.predict import Prediction
from commonrail.calibration.run import Calibration
from commonrail.calibration.study import Study
from commonrail.engine.solution import Batch, Solution
from commonrail.injector.definition import Injector
from commonrail.maps.choices import CellState
from commonrail.maps.quantity_map import InjectionMap
from commonrail.maps.sweep import Sweep
from commonrail.report.fit_arrays import (
    arrays_of_certainty,
    arrays_of_plan,
    arrays_of_posterior,
    arrays_of_prediction,
)
from commonrail.report.named import Array, Arrays, edge, in_edge_units

__all__ = ["Array", "Arrays", "arrays_of", "edge"]


def arrays_of(result: Any) -> Arrays | None:
    """Named arrays of a result; None for one that has none."""
    for kind, make in _MAKERS:
        if isinstance(result, kind):
            return make(result)
    return None


_CHANNELS = {"lift": "m", "pressure": "Pa", "current": "A", "force": "N", "coefficient": "1"}


def _solution(found: Solution) -> Arrays:
    """Middles of the samples; a channel there is the mean of both bounds."""
    values = {"rate": in_edge_units(("time",), found.rate, "m3/s")}
    for name, channel in found.channels.items():
        unit = next((u for ending, u in _CHANNELS.items() if name.endswith(ending)), "")
        values[name] = in_edge_units(("time",), 0.5 * (channel[1:] + channel[:-1]), unit)
    return Arrays({"time": in_edge_units(("time",), found.sample_time, "s")}, values, "Course of an injection")


def _batch(found: Batch) -> Arrays:
    axes = ("candidate", "point")
    sizes = zip(axes, found.injected_mass.shape, strict=True)
    values = {
        "injected_volume": in_edge_units(axes, found.injected_volume, "m3"),
        "returned_volume": in_edge_units(axes, found.returned_volume, "m3"),
        **{name: in_edge_units(axes, getattr(found, name), "s") for name in ("opening", "closing", "first_closing")},
        "greatest_lift": in_edge_units(axes, found.greatest_lift, "m"),
        "status": Array(axes, found.status),
    }
    return Arrays({name: Array((name,), np.arange(size)) for name, size in sizes}, values, "Figures of injections")


def _map(found: InjectionMap) -> Arrays:
    forward, back = ("rail_pressure", "energising_time"), ("rail_pressure", "quantity")
    names = np.vectorize(lambda state: CellState(int(state)).name)
    axes = {
        "rail_pressure": in_edge_units(("rail_pressure",), found.axes.rail_pressure, "Pa"),
        "energising_time": in_edge_units(("energising_time",), found.axes.energising_time, "s"),
        "quantity": in_edge_units(("quantity",), found.axes.quantity, "m3"),
    }
    values = {
        "injected_volume": in_edge_units(forward, found.volume, "m3"),
        "ballistic": Array(forward, found.ballistic),
        "time_for_quantity": in_edge_units(back, found.inverse.energising_time, "s"),
        "state": Array(back, names(found.inverse.state)),
    }
    if found.bands is not None:
        for stem, axis, edges in (
            ("injected_volume", forward, found.bands.quantity),
            ("delivered", back, found.bands.delivered),
        ):
            for level, pair in edges.items():
                for side, volume in zip(("lower", "upper"), pair, strict=True):
                    values[f"{stem}_{100.0 * level:g}_{side}"] = in_edge_units(axis, volume, "m3")
    return Arrays(axes, values, f"Quantity map of {found.injector.name}")


def _sweep(found: Sweep) -> Arrays:
    axes = tuple(v.name for v in found.variables)
    values = {
        "injected_volume": in_edge_units(axes, found.volume, "m3"),
        "opening": in_edge_units(axes, found.opening, "s"),
    }
    if found.two:
        values |= {"second_volume": in_edge_units(axes, found.second, "m3"), "fused": Array(axes, found.fused)}
    return Arrays({v.name: in_edge_units((v.name,), v.values, v.unit) for v in found.variables}, values, "Sweep")


def _calibration(found: Calibration) -> Arrays:
    arrays = _study(found.study)
    best = np.array([found.best[name] for name in found.study.space.names])
    return arrays._replace(values={"calibrated": Array(("parameter",), best), **arrays.values})


def _study(found: Study) -> Arrays:
    """Free parameters in SI units."""
    own = found.space.parameters
    axis = ("parameter",)
    values = {key: Array(axis, np.array([getattr(p, name) for p in own])) for key, name in _BOUNDS.items()}
    return Arrays({"parameter": Array(axis, np.array([p.name for p in own]))}, values, found.title)


_BOUNDS = {"start": "reference", "lower": "lower", "upper": "upper", "unit": "unit"}


def _injector(found: Injector) -> Arrays:
    names = list(found.values)
    axis = ("parameter",)
    values = {
        "value": Array(axis, np.array([found.values[name] for name in names])),
        "unit": Array(axis, np.array([found.quantities[name].unit for name in names])),
        "meaning": Array(axis, np.array([found.quantities[name].meaning for name in names])),
    }
    return Arrays({"parameter": Array(axis, np.array(names))}, values, found.title)


_MAKERS: tuple[tuple[type, Callable[[Any], Arrays]], ...] = (
    (Solution, _solution),
    (Batch, _batch),
    (InjectionMap, _map),
    (Sweep, _sweep),
    (Calibration, _calibration),
    (Study, _study),
    (Injector, _injector),
    (Certainty, arrays_of_certainty),
    (Prediction, arrays_of_prediction),
    (Posterior, arrays_of_posterior),
    (Plan, arrays_of_plan),
)
