"""Metadata of parameters: unit, meaning, domain, usual range."""

from __future__ import annotations

import functools
import math
from enum import Enum
from typing import Any, NamedTuple, get_type_hints


class Domain(Enum):
    """Values that make physical sense for a parameter."""

    POSITIVE = "greater than zero"
    NON_NEGATIVE = "zero or greater"
    UNIT = "between 0 and 1"
    COEFFICIENT = "greater than zero and at most 1"
    CHANGE = "greater than -1"
    CONE = "greater than zero and less than pi rad (180 deg)"
    ANY = "any finite number"

    def admits(self, value: Any) -> Any:
        """Return whether `value` (SI, a number or an array) lies in the domain; NaN never does."""
        if self is Domain.POSITIVE:
            return value > 0.0
        if self is Domain.NON_NEGATIVE:
            return value >= 0.0
        if self is Domain.UNIT:
            return (value >= 0.0) & (value <= 1.0)
        if self is Domain.COEFFICIENT:
            return (value > 0.0) & (value <= 1.0)
        if self is Domain.CHANGE:
            return value > -1.0
        if self is Domain.CONE:
            return (value > 0.0) & (value < math.pi)
        return value == value


class Q(NamedTuple):
    """Metadata of a parameter.

    Attributes
    ----------
    unit, meaning : str
        SI unit, and the quantity.
    domain : Domain
        Values outside are refused.
    default : float or None
        [SI]; None: must be given.
    usual : (low, high) or None
        Range of built injectors [SI]; a value outside is used, and reported as implausible. Zero, where the domain
        holds it, switches the effect off and is never outside.
    """

    unit: str
    meaning: str
    domain: Domain = Domain.POSITIVE
    default: float | None = None
    # Engineering estimates, from passenger-car to heavy-duty injectors with a factor of about 3 to spare: wide enough
    # for any of them, narrow enough that a unit mistaken by 10³ falls outside (a test holds the catalogue to that).
    usual: tuple[float, float] | None = None

    def is_usual(self, value: float, slack: float = 1.0) -> bool:
        """Return whether `value` [SI] lies in the usual range, widened by the factor `slack` at both ends."""
        if self.usual is None or (value == 0.0 and self.domain is Domain.NON_NEGATIVE):
            return True
        low, high = self.usual
        return (low / slack if low > 0.0 else low * slack) <= value <= high * slack


@functools.cache
def describe(parameters: type) -> dict[str, Q]:
    """Name → `Q` of the fields of a ``Parameters`` NamedTuple whose fields are ``Annotated[float, Q]``."""
    hints: dict[str, Any] = get_type_hints(parameters, include_extras=True)
    return {name: hint.__metadata__[0] for name, hint in hints.items()}
