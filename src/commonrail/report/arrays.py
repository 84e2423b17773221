"""Values of results as named arrays in the units that engineers use, for pandas and xarray."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.calibration.run import Calibration
from commonrail.calibration.study import Study
from commonrail.engine.solution import Batch, Solution
from commonrail.injector.definition import Injector
from commonrail.maps.choices import CellState
from commonrail.maps.quantity_map import InjectionMap
from commonrail.maps.sweep import Sweep
from commonrail.units import convert

__all__ = ["Array", "Arrays", "arrays_of", "edge"]

# SI unit of a kind of value, and the unit at the edge.
_EDGE = {"Pa": "MPa", "s": "us", "m3": "mm3", "kg": "mg", "m": "um", "K": "degC", "m3/s": "mm3/ms"}


class Array(NamedTuple):
    """Named values over named axes.

    Attributes
    ----------
    axes : tuple of str
    values : array
        One dimension for each axis.
    unit : str
        Empty for what has none.
    """

    axes: tuple[str, ...]
    values: NDArray[Any]
    unit: str = ""


class Arrays(NamedTuple):
    """Axes by name, arrays over them by name, and the title."""

    axes: dict[str, Array]
    values: dict[str, Array]
    title: str


def edge(unit: str) -> str:
    """Unit in which a value of an SI unit leaves the program."""
    return _EDGE.get(unit, unit)


def arrays_of(result: Any) -> Arrays | None:
    """Named arrays of a result; None for one that has none."""
    for kind, make in _MAKERS:
        if isinstance(result, kind):
            return make(result)
    return None


def _array(axes: tuple[str, ...], values: Any, unit: str) -> Array:
    """Array in the unit at the edge, from SI values."""
    found = np.asarray(values)
    return Array(axes, convert(found, unit, edge(unit)) if unit in _EDGE else found, edge(unit).removesuffix("1"))


_CHANNELS = {"lift": "m", "pressure": "Pa", "current": "A", "force": "N", "coefficient": "1"}


def _solution(found: Solution) -> Arrays:
    """Middles of the samples; a channel there is the mean of both bounds."""
    values = {"rate": _array(("time",), found.rate, "m3/s")}
    for name, channel in found.channels.items():
        unit = next((u for ending, u in _CHANNELS.items() if name.endswith(ending)), "")
        values[name] = _array(("time",), 0.5 * (channel[1:] + channel[:-1]), unit)
    return Arrays({"time": _array(("time",), found.sample_time, "s")}, values, "Course of an injection")


def _batch(found: Batch) -> Arrays:
    axes = ("candidate", "point")
    sizes = zip(axes, found.injected_mass.shape, strict=True)
    values = {
        "injected_volume": _array(axes, found.injected_volume, "m3"),
        "returned_volume": _array(axes, found.returned_volume, "m3"),
        **{name: _array(axes, getattr(found, name), "s") for name in ("opening", "closing", "first_closing")},
        "greatest_lift": _array(axes, found.greatest_lift, "m"),
        "status": Array(axes, found.status),
    }
    return Arrays({name: Array((name,), np.arange(size)) for name, size in sizes}, values, "Figures of injections")


def _map(found: InjectionMap) -> Arrays:
    forward, back = ("rail_pressure", "energising_time"), ("rail_pressure", "quantity")
    names = np.vectorize(lambda state: CellState(int(state)).name)
    axes = {
        "rail_pressure": _array(("rail_pressure",), found.axes.rail_pressure, "Pa"),
        "energising_time": _array(("energising_time",), found.axes.energising_time, "s"),
        "quantity": _array(("quantity",), found.axes.quantity, "m3"),
    }
    values = {
        "injected_volume": _array(forward, found.volume, "m3"),
        "ballistic": Array(forward, found.ballistic),
        "time_for_quantity": _array(back, found.inverse.energising_time, "s"),
        "state": Array(back, names(found.inverse.state)),
    }
    if found.bands is not None:
        for stem, axis, edges in (
            ("injected_volume", forward, found.bands.quantity),
            ("delivered", back, found.bands.delivered),
        ):
            for level, pair in edges.items():
                for side, volume in zip(("lower", "upper"), pair, strict=True):
                    values[f"{stem}_{100.0 * level:g}_{side}"] = _array(axis, volume, "m3")
    return Arrays(axes, values, f"Quantity map of {found.injector.name}")


def _sweep(found: Sweep) -> Arrays:
    axes = tuple(v.name for v in found.variables)
    values = {"injected_volume": _array(axes, found.volume, "m3"), "opening": _array(axes, found.opening, "s")}
    if found.two:
        values |= {"second_volume": _array(axes, found.second, "m3"), "fused": Array(axes, found.fused)}
    return Arrays({v.name: _array((v.name,), v.values, v.unit) for v in found.variables}, values, "Sweep")


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
)
