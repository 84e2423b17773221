"""A map as one JSON object in SI units."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from commonrail.arrays import Floats
from commonrail.display.text import number
from commonrail.maps.choices import CellState
from commonrail.maps.difference import Comparison
from commonrail.maps.quantity_map import InjectionMap, MapBands

__all__ = ["map_record"]


def map_record(found: Mapping[str, InjectionMap], compared: Comparison | None = None) -> dict[str, Any]:
    """Record of maps by the labels of their models; null where there is no number.

    Parameters
    ----------
    found : mapping of str to InjectionMap
    compared : Comparison, optional
        Of the first map with measured data.
    """
    record: dict[str, Any] = {"schema": 1, "kind": "map", "maps": [_one(label, m) for label, m in found.items()]}
    if compared is not None:
        record["measured"] = {
            "source": compared.source,
            "rail_pressure": compared.measured.rail_pressure.tolist(),
            "energising_time": compared.measured.energising_time.tolist(),
            "measured": compared.measured.volume.tolist(),
            "simulated": _numbers(compared.simulated),
            "rms_large": number(compared.rms_large),
            "rms_small": number(compared.rms_small),
        }
    return record


def _one(label: str, found: InjectionMap) -> dict[str, Any]:
    conditions, inverse = found.conditions, found.inverse
    return {
        "label": label,
        "injector": found.injector.name,
        "variant": found.injector.variant.label,
        "synthetic": found.injector.synthetic,
        "conditions": {
            "cylinder_pressure": conditions.cylinder_pressure,
            "return_pressure": conditions.return_pressure,
            "time_step": conditions.time_step,
        },
        "reference_density": found.density,
        "rules": {"several": found.rules.several.value, "unreachable": found.rules.beyond.value},
        "simulations": found.simulations,
        "rail_pressure": found.axes.rail_pressure.tolist(),
        "quantity": found.axes.quantity.tolist(),
        "energising_time": found.axes.energising_time.tolist(),
        "injected_volume": _numbers(found.volume),
        "ballistic": found.ballistic.tolist(),
        "falls_with_pressure": found.falls_with_pressure.tolist(),
        "inverse": {
            "energising_time": _numbers(inverse.energising_time),
            "delivered": _numbers(inverse.delivered),
            "state": [[CellState(state).name for state in row] for row in inverse.state.tolist()],
            "ballistic": found.inverse_ballistic.tolist(),
        },
        "falls": [fall._asdict() for fall in found.falls],
        "bands": None if found.bands is None else _bands(found.bands),
    }


def _bands(bands: MapBands) -> dict[str, Any]:
    """Edges by the share that a band is to hold, over the cells of the quantity map and of the inverse."""
    return {
        "estimator": bands.estimator,
        "levels": list(bands.quantity),
        "injected_volume": [_edges(pair) for pair in bands.quantity.values()],
        "delivered": [_edges(pair) for pair in bands.delivered.values()],
    }


def _edges(pair: tuple[Floats, Floats]) -> dict[str, Any]:
    return {"lower": _numbers(pair[0]), "upper": _numbers(pair[1])}


def _numbers(values: Floats) -> list[Any]:
    if values.ndim == 1:
        return [number(value) for value in values.tolist()]
    return [_numbers(row) for row in values]
