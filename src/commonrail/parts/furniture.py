"""What every part has in its room: parameters that know their unit, meaning and domain."""

from __future__ import annotations

import functools
import math
from enum import Enum
from typing import Annotated, Any, NamedTuple, get_type_hints

__all__ = ["Annotated", "Domain", "Q", "describe"]


class Domain(Enum):
    """Values that make physical sense for a parameter."""

    POSITIVE = "greater than zero"
    NON_NEGATIVE = "zero or greater"
    UNIT = "between 0 and 1"
    COEFFICIENT = "greater than zero and at most 1"
    CONE = "greater than zero and less than pi rad (180 deg)"
    ANY = "any finite number"

    def admits(self, value: Any) -> Any:
        """Whether `value` (SI, a number or an array) lies in the domain; NaN never does."""
        if self is Domain.POSITIVE:
            return value > 0.0
        if self is Domain.NON_NEGATIVE:
            return value >= 0.0
        if self is Domain.UNIT:
            return (value >= 0.0) & (value <= 1.0)
        if self is Domain.COEFFICIENT:
            return (value > 0.0) & (value <= 1.0)
        if self is Domain.CONE:
            return (value > 0.0) & (value < math.pi)
        return value == value


class Q(NamedTuple):
    """Metadata of a parameter: SI unit, meaning, domain and default (None: must be given)."""

    unit: str
    meaning: str
    domain: Domain = Domain.POSITIVE
    default: float | None = None


@functools.cache
def describe(parameters: type) -> dict[str, Q]:
    """Name → `Q` of the fields of a ``Parameters`` NamedTuple whose fields are ``Annotated[float, Q]``."""
    hints: dict[str, Any] = get_type_hints(parameters, include_extras=True)
    return {name: hint.__metadata__[0] for name, hint in hints.items()}
