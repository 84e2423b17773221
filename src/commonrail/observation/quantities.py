"""Quantities of a meter: unit, meaning, domain and neutral value of each, and their names as free parameters."""

from __future__ import annotations

from collections.abc import Mapping

from commonrail.injector.definition import parameter_quantities
from commonrail.parts.furniture import Domain, Q

__all__ = ["PREFIX", "QUANTITIES", "is_of_meter", "known_quantity", "parameter_name", "parts_of"]

PREFIX = "meter"  # of the dotted name of a free quantity: meter.bench.delay

_INF = float("inf")
_ECHO = "echo of the signal in the meter's tube"
_SECOND = "second echo of the signal in the meter's tube"

# A quantity without a default is absent unless it is given.
QUANTITIES: Mapping[str, Q] = {
    "delay": Q("s", "delay of the signal behind the flow", Domain.ANY, 0.0),
    "gain": Q("1", "factor on the rate or the quantity", Domain.POSITIVE, 1.0),
    "offset": Q("m3/s", "rate that is shown without flow", Domain.ANY, 0.0),
    "quantity_offset": Q("m3", "quantity per stroke that is shown without an injection", Domain.ANY, 0.0),
    "cutoff": Q("Hz", "cut-off frequency of the low-pass", Domain.POSITIVE, _INF),
    "late_cutoff": Q("Hz", "cut-off frequency of the low-pass after the opening peak", Domain.POSITIVE),
    "blend": Q("s", "time from the opening peak in which the late cut-off replaces the first", Domain.POSITIVE, 2e-4),
    "echo_share": Q("1", f"share of the {_ECHO}", Domain.ANY, 0.0),
    "echo_delay": Q("s", f"delay of the {_ECHO}", Domain.NON_NEGATIVE, 0.0),
    "echo_lag": Q("s", f"time constant of the {_ECHO}", Domain.NON_NEGATIVE, 0.0),
    "second_echo_share": Q("1", f"share of the {_SECOND}", Domain.ANY, 0.0),
    "second_echo_delay": Q("s", f"delay of the {_SECOND}", Domain.NON_NEGATIVE, 0.0),
    "second_echo_lag": Q("s", f"time constant of the {_SECOND}", Domain.NON_NEGATIVE, 0.0),
    "zeroing": Q("1", "share of the direct signal's peak below which the signal is set to zero", Domain.UNIT, 0.0),
    "density": Q("kg/m3", "density that makes the meter's volumes of masses", Domain.POSITIVE),
    "temperature": Q("K", "temperature of the fuel in the meter", Domain.POSITIVE),
}


def parameter_name(meter: str, quantity: str) -> str:
    """Dotted name of a quantity as a free parameter: meter.bench.delay."""
    return f"{PREFIX}.{meter}.{quantity}"


def is_of_meter(name: str) -> bool:
    """True for the dotted name of a meter's quantity, False for that of an injector's parameter."""
    return name.startswith(f"{PREFIX}.")


def parts_of(name: str) -> tuple[str, str]:
    """Meter and quantity of a dotted name."""
    _, meter, quantity = name.split(".", 2)
    return meter, quantity


def known_quantity(name: str) -> Q:
    """Unit, meaning and domain of a free parameter, of an injector or of a meter.

    Raises
    ------
    KeyError
        If there is none of that name.
    """
    return QUANTITIES[parts_of(name)[1]] if is_of_meter(name) else parameter_quantities()[name]
