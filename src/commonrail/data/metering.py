"""Meters of data sets, shared by several, and checks of their consistency."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from commonrail.base.errors import ConfigurationError
from commonrail.data.base import DataSet
from commonrail.physics.injector import Injector
from commonrail.physics.meters import QUANTITIES, Meter, is_of_meter, parts_of
from commonrail.readers.toml import UNSTATED


def list_meters(data: Iterable[DataSet]) -> tuple[Meter, ...]:
    """Meters of data sets, each once, in their order."""
    return tuple({d.meter.name: d.meter for d in data if d.meter is not None}.values())


def with_meters(data: Sequence[DataSet], meters: Iterable[Meter]) -> tuple[DataSet, ...]:
    """Data sets with other meters in place of those with the same names."""
    by_name = {meter.name: meter for meter in meters}
    return tuple(d if d.meter is None else d.changed(meter=by_name.get(d.meter.name, d.meter)) for d in data)


def check_meters(injector: Injector, data: Sequence[DataSet], limits: Mapping[str, Sequence[float]]) -> None:
    """Refuse meters that contradict each other, the fuel, or the lower and upper `limits` [SI] of free parameters.

    Raises `ConfigurationError` if two meters have one name, a temperature leaves the fuel's range, a bound leaves the
    domain of its quantity, or no data set depends on a free quantity.
    """
    meters = {meter.name: meter for meter in list_meters(data)}
    for d in data:
        if d.meter is not None and d.meter != meters[d.meter.name]:
            raise ConfigurationError(
                f"{d.name}: another meter is also called {d.meter.name}; give the two different names."
            )
    for name, bounds in limits.items():
        if is_of_meter(name):
            _check_free(name, bounds, data)
    for meter in meters.values():
        temperatures = [meter.values["temperature"]] if "temperature" in meter.values else []
        _check_temperatures(meter, [*temperatures, *limits.get(meter.parameter("temperature"), ())], injector)


def _check_free(name: str, bounds: Sequence[float], data: Sequence[DataSet]) -> None:
    of_meter, quantity = parts_of(name)
    q = QUANTITIES[quantity]
    if not all(q.domain.admits(bound) for bound in bounds):
        raise ConfigurationError(
            f"The bounds of {name} are {bounds[0]:g} and {bounds[1]:g} {q.unit.removesuffix('1')}".rstrip()
            + f", and the {q.meaning} must be {q.domain.value}; narrow them."
        )
    meters = [d.meter for d in data if d.meter is not None and d.meter.name == of_meter and quantity in d.meter_inputs]
    if not meters:
        raise ConfigurationError(
            f"{name} is free, and no data set with the meter {of_meter} depends on its {quantity}; fix it or remove it."
        )
    if q.default is None and quantity not in meters[0].values:
        raise ConfigurationError(f"{name} is free and has no start value; give one in the meter {of_meter}.")


def _check_temperatures(meter: Meter, temperatures: Sequence[float], injector: Injector) -> None:
    low, high = injector.fuel.temperature_range
    for temperature in temperatures:
        if not low <= temperature <= high:
            raise ConfigurationError(
                f"The temperature of the meter {meter.name}, {temperature:g} K, lies outside the range of "
                f"{injector.fuel.name}, {low:g} K to {high:g} K."
            )


def meter_records(meters: Sequence[Meter]) -> dict[str, Any]:
    """JSON-able meters under the key "meters"; empty without meters."""
    records = [
        {
            "name": meter.name,
            "law": meter.law.value,
            "order": meter.order,
            "quantities": [
                {
                    "name": key,
                    "value": value,
                    "unit": QUANTITIES[key].unit,
                    "meaning": QUANTITIES[key].meaning,
                    **meter.sources.get(key, UNSTATED)._asdict(),
                }
                for key, value in meter.values.items()
            ],
        }
        for meter in meters
    ]
    return {"meters": records} if records else {}
