"""Usual ranges of parameters: how far an estimate is off where nobody has measured."""

from __future__ import annotations

import math
from dataclasses import replace

from commonrail.base.errors import ConfigurationError
from commonrail.calibration.parameter import Parameter, Prior
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector
from commonrail.physics.law import Domain

# Half widths of ranges as shares of the value, chosen: how far an estimate is off where nobody has measured.
LENGTH, SMALL_LENGTH, ANGLE, COEFFICIENT, OTHER = 0.05, 0.2, 0.1, 0.15, 0.4
# Length below which a part is measured with difficulty [m]: estimates of the catalogue's injectors differ by 10 to 37 %
# up to the diameter of the needle's seat, and by 0.2 % for the plunger's.
SMALL = 2.5e-3
TEMPERATURE = 15.0  # how far the fuel's temperature at the injector may be from that in the tank [K]
REACH, LEAST_SHARE = 2.5, 0.2  # bounds about a prior, in half widths; smallest share of the value
USUAL = "how far an estimate is usually off"  # source of a prior


def usual_parameter(injector: Injector, name: str, wider: float = 1.0) -> Parameter:
    """Parameter with the range that is usual for what nobody has measured, within its domain.

    `wider`: factor on the range of a length. A value of zero has the usual range in built injectors. Raises
    `ConfigurationError` if no range is known.
    """
    q, value = injector.quantities[name], injector.values[name]
    if name == FUEL_TEMPERATURE:
        return _temperature(injector, value)
    share = {"m": LENGTH, "rad": ANGLE, "1": COEFFICIENT}.get(q.unit, OTHER)
    if q.unit == "m" and abs(value) < SMALL:
        share = SMALL_LENGTH
    share *= wider if q.unit == "m" else 1.0
    low, high = sorted((value * (1.0 - share), value * (1.0 + share)))
    if value == 0.0 and q.usual is not None:
        low, high = min(0.0, q.usual[0]), max(0.0, q.usual[1])
    if not low < high:
        raise ConfigurationError(f"{name} is zero, and no usual range of it is known; state its bounds in the study.")
    high = min(high, 1.0) if q.domain in (Domain.COEFFICIENT, Domain.UNIT) else high
    source = injector.sources[name]
    return Parameter(name, value, low, high, q.unit, mark=source.mark, source=source.text, signed=True)  # type: ignore[arg-type]


def _temperature(injector: Injector, value: float) -> Parameter:
    """Fuel temperature within what a bench leaves open, and the range of the fuel."""
    low, high = injector.fuel.temperature_range
    ends = max(value - TEMPERATURE, low), min(value + TEMPERATURE, high)
    source = injector.sources[FUEL_TEMPERATURE]
    return Parameter(FUEL_TEMPERATURE, value, *ends, "K", mark=source.mark, source=source.text)  # type: ignore[arg-type]


def with_usual_prior(injector: Injector, parameter: Parameter) -> Parameter:
    """Parameter whose usual range is the standard deviation of a prior, within bounds beyond it."""
    value, half = parameter.reference, abs(parameter.reference - parameter.lower)
    if value == 0.0:  # its range is no estimate of how far it is off
        return parameter
    if parameter.name == FUEL_TEMPERATURE:
        return replace(parameter, prior=Prior(value, 0.5 * TEMPERATURE, USUAL))
    ends = (
        value - math.copysign(min(REACH * half, (1.0 - LEAST_SHARE) * abs(value)), value),
        value + math.copysign(REACH * half, value),
    )
    low, high = sorted(ends)
    if injector.quantities[parameter.name].domain in (Domain.COEFFICIENT, Domain.UNIT):
        high = min(high, 1.0)
    return replace(parameter, lower=low, upper=high, prior=Prior(value, half, USUAL))


BENCH = "bench"  # name of a meter that is added to a study
UNNAMED = "unnamed"  # that of data sets which state none, where a name is needed

# Quantities of a meter: start, bounds and scale of a search for what nobody has stated [E].
USUAL_OF_METER: dict[str, dict[str, str | float]] = {
    "delay": {"start": "0 us", "lower": "-50 us", "upper": "500 us"},
    "cutoff": {"start": "20 kHz", "lower": "2 kHz", "upper": "200 kHz", "scale": "log"},
    "gain": {"start": 1.0, "lower": 0.8, "upper": 1.25},
    "offset": {"start": "0 mm3/ms", "lower": "-1 mm3/ms", "upper": "1 mm3/ms"},
    "quantity_offset": {"start": "0 mm3", "lower": "-1 mm3", "upper": "1 mm3"},
}
