"""One parameter to be calibrated: reference, bounds, unit, origin and scale."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from math import isfinite
from typing import Literal

from commonrail.arguments import COUNTS
from commonrail.calibration.prior import Prior
from commonrail.errors import ConfigurationError
from commonrail.injector.definition import parameter_quantities

__all__ = ["Mark", "Parameter", "Scale", "percent_bounds"]

Mark = Literal["M", "C", "F", "E"]
Scale = Literal["linear", "log"]

NEAR = 0.01  # a value this close to a bound, as a share of the range, is at it


def percent_bounds(reference: float, a_min: float, a_max: float, name: str = "parameter") -> tuple[float, float]:
    """Bounds from percentages of a reference, Eq. (16).

    Parameters
    ----------
    reference : float
        Reference value, SI, greater than zero.
    a_min, a_max : float
        Percent below and above the reference. The paper takes both in [0, 100]; its own optimum
        of k1 lies 148 % above the reference, so any `a_max` > 0 is taken here.
    name : str
        The parameter, for messages.

    Returns
    -------
    tuple of float
        (1 - a_min/100) reference and (1 + a_max/100) reference.

    Raises
    ------
    ConfigurationError
        If the percentages would cross the bounds or make them negative.
    """
    if not (isfinite(reference) and reference > 0.0):
        raise ConfigurationError(
            f"{name}: bounds in percent need a reference greater than zero, found {reference:g}; "
            "give lower and upper instead"
        )
    if not 0.0 <= a_min <= 100.0:
        raise ConfigurationError(
            f"{name}: a_min = {a_min:g} % must lie between 0 and 100, or the lower bound would "
            "be negative or above the reference"
        )
    if not (isfinite(a_max) and a_max > 0.0):
        raise ConfigurationError(f"{name}: a_max = {a_max:g} % must be a number greater than 0")
    return (1.0 - a_min / 100.0) * reference, (1.0 + a_max / 100.0) * reference


@dataclass(frozen=True)
class Parameter:
    """One parameter to be calibrated, as a person knows it.

    Parameters
    ----------
    name : str
        Part and field, such as ``plunger_needle.k7``.
    reference : float
        Value before calibration, SI; it may lie outside the bounds.
    lower, upper : float
        Bounds, SI, lower < upper; `percent_bounds` gives those of Eq. (16).
    unit : str
        SI unit.
    mark : {"M", "C", "F", "E"}
        Where the reference comes from: measured, ECU calibration, fitted or derived, estimate.
    source : str
        Source of the reference and the bounds.
    scale : {"linear", "log"}
        Scale on which the optimiser moves.
    prior : Prior, optional
        Knowledge of the parameter besides the data; its value lies within the bounds.
    signed : bool
        True for a quantity that may have either sign, such as the delay of a meter.

    Raises
    ------
    ConfigurationError
        If a number is not finite, the bounds are crossed, a positive quantity is given a
        negative bound (or a logarithmic scale one that is not positive), or the prior's value
        lies outside the bounds.
    """

    name: str
    reference: float
    lower: float
    upper: float
    unit: str
    _: KW_ONLY
    mark: Mark
    source: str
    scale: Scale = "linear"
    prior: Prior | None = None
    signed: bool = False

    def __post_init__(self) -> None:
        if not all(map(isfinite, (self.reference, self.lower, self.upper))):
            self._refuse("reference, lower and upper must be finite numbers")
        if self.name in COUNTS:
            self._refuse("it counts pieces, and values between whole numbers mean nothing; fix it")
        if self.lower > self.upper:
            self._refuse("the lower bound lies above the upper; exchange them")
        if self.lower == self.upper:
            self._refuse("the lower bound must be less than the upper; fix the value instead")
        if self.lower < 0.0 < self.reference and not (self.signed or self._may_be_negative):
            self._refuse("the lower bound of a positive quantity must not be negative")
        if self.mark not in ("M", "C", "F", "E"):
            self._refuse(f'mark "{self.mark}" must be M, C, F or E')
        if self.scale not in ("linear", "log"):
            self._refuse(f'scale "{self.scale}" must be "linear" or "log"')
        if self.scale == "log" and self.lower <= 0.0:
            self._refuse("a logarithmic scale needs a lower bound greater than zero")
        if self.prior is not None and not self.lower <= self.prior.value <= self.upper:
            self._refuse(f"the prior's value {self.prior.value:g} lies outside the bounds; widen them or correct it")

    def position(self, value: float) -> float:
        """Place of a value between the bounds: 0 at the lower, 1 at the upper."""
        return (value - self.lower) / (self.upper - self.lower)

    def is_at_bound(self, value: float) -> bool:
        """True for a value that has ended at a bound."""
        position = self.position(value)
        return bool(min(position, 1.0 - position) < NEAR)

    @property
    def _may_be_negative(self) -> bool:
        quantity = parameter_quantities().get(self.name)
        return quantity is not None and quantity.domain.admits(self.lower)

    def _refuse(self, why: str) -> None:
        raise ConfigurationError(
            f"{self.name}: {why} (reference {self.reference:g}, bounds {self.lower:g} to {self.upper:g} "
            f"{self.unit.removesuffix('1')}".rstrip()
            + ")"
        )
