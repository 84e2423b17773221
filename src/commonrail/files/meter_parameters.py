"""Free parameters of a search for the quantities of meters that a study gives bounds."""

from __future__ import annotations

from collections.abc import Mapping

from commonrail.calibration.parameter import Parameter
from commonrail.calibration.prior import Prior
from commonrail.files.meter_models import Amount, MeterHead
from commonrail.injector.definition import Source
from commonrail.observation.quantities import QUANTITIES, parameter_name
from commonrail.parts.furniture import Domain, Q
from commonrail.reading.place import Place, located

__all__ = ["free_parameters"]


def free_parameters(tables: Mapping[str, MeterHead], at: Place) -> list[Parameter]:
    """Parameters of a search for the quantities of meters that have bounds.

    Parameters
    ----------
    tables, at
        As for `meters_of_tables`.

    Raises
    ------
    ConfigurationError
        If bounds are crossed or do not hold the start value.
    """
    return [
        _parameter(parameter_name(name, key), amount, QUANTITIES[key], table.origin(), at / name / key)
        for name, table in tables.items()
        for key, amount in table.amounts()
        if amount.free
    ]


def _parameter(name: str, amount: Amount, q: Q, default: Source, at: Place) -> Parameter:
    source, start = amount.origin(default), amount.at_start(q)
    assert amount.lower is not None
    assert amount.upper is not None
    with located(at):
        found = Parameter(
            name,
            start,
            amount.lower,
            amount.upper,
            q.unit,
            mark=source.mark,  # type: ignore[arg-type]  # read as a mark
            source=source.text,
            scale=amount.scale,
            prior=_prior(amount, start, at / "prior"),
            signed=q.domain is Domain.ANY,
        )
    if not amount.lower <= start <= amount.upper:
        raise at.error(f"the start value {start:g} must lie between lower and upper")
    return found


def _prior(amount: Amount, start: float, at: Place) -> Prior | None:
    """The prior that a quantity states, about its start value unless it gives another."""
    if amount.prior is None:
        return None
    value = start if amount.prior.value is None else amount.prior.value
    with located(at):
        return Prior(value, amount.prior.sigma, amount.prior.source)
