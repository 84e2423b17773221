"""One parameter to be calibrated: reference, bounds, unit, origin and scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from enum import StrEnum
from typing import Any, Literal

import numpy as np

from commonrail.base.arguments import COUNTS, enum_member, instance, number, plain_text, settle, shown
from commonrail.base.arrays import Bools, Floats
from commonrail.base.errors import ConfigurationError
from commonrail.data.base import past_stops
from commonrail.data.simulator import Simulator
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.solution import Batch
from commonrail.engine.status import OK, check_point
from commonrail.physics.injector import Injector, parameter_quantities

# Conditions that a candidate must meet at operating points besides its fit to the data.

NOTHING = 1e-12  # volume per stroke [m³] up to which nothing is injected: far below what a bench resolves


class Wanted(StrEnum):
    """Behaviour that is wanted of the injector at an operating point."""

    SUCCEEDS = "succeeds"
    """The simulation succeeds: the needle closes again, and no number runs away."""

    SHUT = "stays shut"
    """It succeeds and nothing is injected."""

    INJECTS = "injects"
    """It succeeds and something is injected."""

    NEEDLE_AT_STOP = "needle reaches its stop"
    """It succeeds and the plunger touches its upper stop."""

    NEEDLE_OFF_STOP = "needle stays off its stop"
    """It succeeds and the plunger does not touch its upper stop."""

    VALVE_AT_STOP = "valve reaches its stop"
    """It succeeds and the valve touches its stop."""

    VALVE_OFF_STOP = "valve stays off its stop"
    """It succeeds and the valve does not touch its stop."""


_NEEDLE, _VALVE = "plunger_needle.stop_lift", "valve.lift"  # parameters that say where a stop is
_STOPS = dict.fromkeys((Wanted.NEEDLE_AT_STOP, Wanted.NEEDLE_OFF_STOP), _NEEDLE)
_STOPS |= dict.fromkeys((Wanted.VALVE_AT_STOP, Wanted.VALVE_OFF_STOP), _VALVE)
_AT = {Wanted.NEEDLE_AT_STOP, Wanted.VALVE_AT_STOP}


@dataclass(frozen=True)
class Condition:
    """Behaviour that is wanted at an operating point; a candidate without it loses.

    Parameters
    ----------
    wanted : Wanted
    point : OperatingPoint

    Raises
    ------
    ConfigurationError
        If an argument is of another kind.
    """

    wanted: Wanted
    point: OperatingPoint

    def __post_init__(self) -> None:
        settle(self, wanted=enum_member(self.wanted, Wanted, "wanted"))
        instance(self.point, OperatingPoint, "point of a condition")


def check_condition(injector: Injector, condition: Condition) -> None:
    """Refuse (`ConfigurationError`) a condition on a part that the injector lacks, or at a point beyond its fuel."""
    lacking = ""
    if condition.wanted in _STOPS and _STOPS[condition.wanted] not in injector.values:
        lacking = f"is a {injector.variant.actuation.value} injector without this stop"
    if injector.variant.drive.is_trace and condition.point.drive is None:
        lacking = "is driven by a measured trace, which a condition lacks"
    if lacking:
        raise ConfigurationError(f'"{condition.wanted}" is wanted, and {injector.name} {lacking}; remove it.')
    check_point(injector, condition.point)


def broken(conditions: Sequence[Condition], batch: Batch, past: Floats | None = None) -> Bools:
    """Mask (candidates, conditions) of the conditions that candidates do not meet.

    `batch`: candidates at the points of the conditions, in order; `past` (candidates, conditions): of `distances_past`;
    needed where a condition is about a stop.
    """
    failed = batch.status != OK
    injects = batch.injected_mass / batch.reference_density > NOTHING
    shut = np.array([condition.wanted is Wanted.SHUT for condition in conditions])
    open_ = np.array([condition.wanted is Wanted.INJECTS for condition in conditions])
    is_broken = np.asarray(failed | (injects & shut) | (~injects & open_))
    if past is None:
        return is_broken
    reaches = np.array([condition.wanted in _AT for condition in conditions])
    keeps_off = np.array([condition.wanted in _STOPS.keys() - _AT for condition in conditions])
    touches = past > 0.0  # False where the simulation failed, which breaks the condition anyway
    return np.asarray(is_broken | (~touches & reaches) | (touches & keeps_off))


def distances_past(conditions: Sequence[Condition], simulator: Simulator, values: Floats) -> Floats | None:
    """Distances beyond the stop that each condition names, (candidates, conditions) [m]; None if none names a stop.

    NaN for conditions that name none, and for failed simulations. Each condition that does costs one more simulation,
    in f64.

    `values` (candidates, names): [SI].
    """
    if not any(condition.wanted in _STOPS for condition in conditions):
        return None
    distances = np.full((len(values), len(conditions)), np.nan)
    for i, condition in enumerate(conditions):
        if condition.wanted in _STOPS:
            past = past_stops(simulator, condition.point, values)
            distances[:, i] = past.needle if _STOPS[condition.wanted] == _NEEDLE else past.valve
    return distances


# Prior knowledge of a parameter: a value, its standard deviation and its source.


@dataclass(frozen=True)
class Prior:
    """Normal distribution that a parameter has before the data are seen.

    Parameters
    ----------
    value : float
        Mean, SI.
    sigma : float
        Standard deviation, SI, greater than zero.
    source : str
        Source of both.

    Raises
    ------
    ConfigurationError
        If a number is not finite, or sigma is not greater than zero.
    """

    value: float
    sigma: float
    source: str = "no source stated"

    def __post_init__(self) -> None:
        plain_text(self.source, "source of a prior")
        settle(
            self, value=number(self.value, "1", "value of a prior"), sigma=number(self.sigma, "1", "sigma of a prior")
        )
        if not self.sigma > 0.0:
            raise ConfigurationError(
                f"A prior needs a value and a sigma greater than zero, not {self.value:g} and {self.sigma:g}.",
                code="wrong-prior",
            )

    def residual(self, value: float) -> float:
        """Distance of a value from the prior's in standard deviations: (x - value)/sigma."""
        return (value - self.value) / self.sigma


class Priors:
    """Priors of the parameters of a space, as residuals (x - value)/sigma.

    `priors`: one for each parameter, in order; None where there is no prior.
    """

    def __init__(self, priors: Sequence[Prior | None] = ()) -> None:
        stated = [(column, prior) for column, prior in enumerate(priors) if prior is not None]
        self.columns = np.array([column for column, _ in stated], dtype=np.intp)
        self._value = np.array([prior.value for _, prior in stated])
        self._sigma = np.array([prior.sigma for _, prior in stated])

    @classmethod
    def of(cls, parameters: Sequence[Any]) -> Priors:
        """Priors of parameters that have the attribute `prior`."""
        return cls([parameter.prior for parameter in parameters])

    def __len__(self) -> int:
        return len(self.columns)

    @property
    def sigmas(self) -> Floats:
        """Standard deviations (priors,), SI."""
        return self._sigma

    def residuals(self, x: Floats) -> Floats:
        """Residuals (n, priors) of points (n, d), SI."""
        return np.asarray((x[:, self.columns] - self._value) / self._sigma)

    def costs(self, x: Floats) -> Floats:
        """Sum (n,) of the squares of the residuals of points (n, d), SI."""
        return np.asarray(np.sum(self.residuals(x) ** 2, axis=1))


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
    reference, a_min, a_max = (
        number(value, "1", f"{what} of {name}")
        for what, value in (("reference", reference), ("a_min", a_min), ("a_max", a_max))
    )
    if not reference > 0.0:
        raise ConfigurationError(
            f"{name}: bounds in percent need a reference greater than zero, found {reference:g}; "
            "give lower and upper instead",
            code="no-reference",
        )
    if not 0.0 <= a_min <= 100.0:
        raise ConfigurationError(
            f"{name}: a_min = {a_min:g} % must lie between 0 and 100, or the lower bound would "
            "be negative or above the reference",
            code="out-of-range",
        )
    if not a_max > 0.0:
        raise ConfigurationError(f"{name}: a_max = {a_max:g} % must be a number greater than 0", code="out-of-range")
    return (1.0 - a_min / 100.0) * reference, (1.0 + a_max / 100.0) * reference


@dataclass(frozen=True)
class Parameter:
    """One parameter to be calibrated, as a person knows it.

    Parameters
    ----------
    name : str
        Part and field, such as ``plunger_needle.k7``.
    reference : float or str
        Value before calibration, SI or with its unit; it may lie outside the bounds.
    lower, upper : float or str
        Bounds, SI or with their units, lower < upper; `percent_bounds` gives those of Eq. (16).
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
        If a number is not finite, the unit is not that of the parameter, the bounds are crossed, a
        positive quantity is given a negative bound (or a logarithmic scale one that is not positive),
        or the prior's value lies outside the bounds.
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
        quantity = parameter_quantities().get(plain_text(self.name, "name of a parameter"))
        if quantity is not None and quantity.unit != self.unit:
            raise ConfigurationError(f'{self.name}: the unit is "{quantity.unit}", not {shown(self.unit)}.')
        read = {what: getattr(self, what) for what in ("reference", "lower", "upper")}
        settle(self, **{what: number(value, self.unit, f"{what} of {self.name}") for what, value in read.items()})
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
            + ")",
            code="wrong-bounds",
        )
