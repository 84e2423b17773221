"""Noise of a data set as a study states it: law, correlation, size, discrepancy, uncertain quantities of the bench."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from numbers import Real
from typing import Annotated, Any

from pydantic import Field

from commonrail.base.arguments import Quantity, enum_member, mapping, number, settle, shown
from commonrail.base.errors import ConfigurationError, nearest
from commonrail.base.units import parse
from commonrail.physics.injector import FUEL_TEMPERATURE, parameter_quantities
from commonrail.physics.meters import QUANTITIES, is_of_meter
from commonrail.readers.location import Place, locate_errors
from commonrail.readers.toml import FileModel, Unit

# Quantities of the bench that may be uncertain by their own names; an injector's parameter is one by its dotted name.
OF_METER = ("delay", "gain", "offset", "quantity_offset", "cutoff")
TEMPERATURE = "fuel_temperature"
MOST_KELVIN = 100.0  # a larger deviation is a temperature in degrees Celsius that was read as one


class Law(StrEnum):
    """Distribution of the noise."""

    AUTO = "auto"
    """Gaussian; Student's t where more than 1 % of at least 50 values lie beyond four standard deviations."""

    GAUSSIAN = "gaussian"
    STUDENT = "student-t"
    """With four degrees of freedom, for outliers."""

    LAPLACE = "laplace"
    """Its most likely values are those of the least sum of magnitudes, as the paper's J."""


class Correlation(StrEnum):
    """Correlation of the noise along a course in time."""

    AUTO = "auto"
    """Autoregressive, of the order up to 15 that has the least AIC; white for values that are not a time series."""

    WHITE = "white"
    AUTOREGRESSIVE = "autoregressive"


@dataclass(frozen=True)
class Noise:
    """Noise model of a data set.

    Attributes
    ----------
    law : Law
    correlation : Correlation
    sigma : float or None
        Standard deviation of one value under every law, in the unit of the kind's residuals [SI]: m³/s for a curve,
        multiples of the tolerance for a map. None: estimated from the residuals. With `relative`, its part at a rate
        of zero.
    freedom : float
        Degrees of freedom of `sigma`, such as repeats − 1 of the strokes that it was estimated from; infinite where it
        is exactly known.
    shots : str
        Name of a group of repeated shots, empty for none: standard deviation and correlation are then estimated from
        the differences between the data sets of the group.
    discrepancy : float
        Standard deviation of what the model cannot do, in the same unit.
    length : float
        Time over which the discrepancy is correlated [s]: along a course, or between the energising times of a map;
        0 for none.
    pressure_length : float
        Rail pressure over which the discrepancy of a map is correlated [Pa]; infinite for full correlation.
    uncertain : mapping of str to float
        Standard deviations [SI] of uncertain values that are not fitted: delay, gain, offset, quantity_offset and
        cutoff of the meter, fuel_temperature, or an injector's parameter by its dotted name.
    relative : float
        Share of the rate that the standard deviation of a curve grows by: it is sigma + relative · rate. Shots scatter
        in proportion to the rate. Where no sigma is stated, the residuals tell whether it grows.
    scatter : float
        Standard error of the whole curve as a share of it, such as that of a mean of shots whose quantities scatter:
        common to all samples, and invisible in the noise of single samples.
    scatter_freedom : float
        Degrees of freedom of `scatter`: shots − 1; infinite where it is exactly known.

    Raises
    ------
    ConfigurationError
        If a number is negative or not finite, or a quantity is unknown.
    """

    law: Law = Law.AUTO
    correlation: Correlation = Correlation.AUTO
    sigma: float | None = None
    shots: str = ""
    discrepancy: float = 0.0
    length: float = 0.0
    pressure_length: float = math.inf
    uncertain: Mapping[str, Quantity] = field(default_factory=dict)
    freedom: float = math.inf
    relative: float = 0.0
    scatter: float = 0.0
    scatter_freedom: float = math.inf

    def __post_init__(self) -> None:
        uncertain = mapping(self.uncertain, "uncertain quantities of the noise", '{"delay": "1 us"}')
        settle(
            self,
            law=enum_member(self.law, Law, "law of the noise"),
            correlation=enum_member(self.correlation, Correlation, "correlation of the noise"),
            uncertain={key: _deviation(key, value) for key, value in uncertain.items()},
        )
        stated = "sigma", "pressure_length", "freedom", "scatter_freedom"
        for what in (*stated, "discrepancy", "length", "relative", "scatter"):
            value, positive = getattr(self, what), what in stated
            if value is None and what == "sigma":
                continue
            what = what.replace("relative", "relative part")
            if not isinstance(value, Real):
                raise ConfigurationError(f"The {what} of the noise must be a number, not {shown(value)}.")
            size = float(value)
            if not (size > 0.0 if positive else 0.0 <= size < math.inf):
                least = "greater than zero" if positive else "zero or greater"
                raise ConfigurationError(f"The {what} of the noise must be {least}, not {size:g}.")
        if self.sigma is None and self.freedom < math.inf:
            raise ConfigurationError("The freedom of the noise is that of its sigma, which is missing; add it.")
        if self.relative > 1.0:
            raise ConfigurationError(f"The relative part of the noise must be at most 100 %, not {self.relative:.0%}.")
        if self.sigma is None and self.relative:
            raise ConfigurationError(
                "The relative part of the noise has no sigma at a rate of zero beside it; state both, as in "
                'sigma = "0.02 mm3/ms + 1 %", or neither, and the residuals tell.'
            )
        if self.sigma is not None and self.shots:
            raise ConfigurationError("The noise has a sigma and repeated shots to estimate it from; keep one of them.")

    @property
    def measured(self) -> dict[str, Any]:
        """Standard error, degrees of freedom and scatter from repeated shots, by the names of the attributes."""
        return {"sigma": self.sigma, "freedom": self.freedom, **self.measured_scatter}

    @property
    def measured_scatter(self) -> dict[str, Any]:
        """The part of `measured` that describes the scatter from shot to shot."""
        return {"scatter": self.scatter, "scatter_freedom": self.scatter_freedom}

    @property
    def deviations(self) -> Mapping[str, float]:
        """The uncertain quantities with their standard deviations [SI]."""
        return {key: float(value) for key, value in self.uncertain.items()}


def uncertain_unit(key: str) -> str:
    """SI unit of a quantity that may be uncertain.

    Raises `ConfigurationError` for an unknown name.
    """
    if key in OF_METER:
        return QUANTITIES[key].unit
    name = FUEL_TEMPERATURE if key == TEMPERATURE else key
    if is_of_meter(name) or name not in parameter_quantities():
        others = [*OF_METER, TEMPERATURE]
        raise ConfigurationError(
            f"{key} cannot be uncertain{nearest(key, [*others, *parameter_quantities()])}; {', '.join(others)} and the "
            "parameters of an injector can."
        )
    return parameter_quantities()[name].unit


def _deviation(key: str, value: object) -> float:
    unit = uncertain_unit(key)
    deviation = number(value, unit, f"standard deviation of {key}")
    if not 0.0 < deviation < math.inf:
        raise ConfigurationError(f"The standard deviation of {key} must be greater than zero, not {deviation:g}.")
    if unit == "K" and deviation > MOST_KELVIN:
        raise ConfigurationError(
            f"The standard deviation of {key} is {deviation:g} K; state the difference, as in 3 K."
        )
    return deviation


NOISE = Noise()


# Shape of the table ``noise`` of a data set in a study file.

MOST_UNCERTAIN = 20


class NoiseModel(FileModel):
    """Noise of a data set; omitted keys are estimated from the residuals, or zero."""

    law: Law = Field(default=Law.AUTO, strict=False)
    correlation: Correlation = Field(default=Correlation.AUTO, strict=False)
    sigma: str | float | int | None = None
    freedom: float = math.inf
    shots: str = ""
    discrepancy: str | float | int = 0.0
    length: Annotated[float, Unit("s")] = 0.0
    pressure_length: Annotated[float, Unit("Pa")] = math.inf
    uncertain: dict[str, str | float | int] = Field(default={}, max_length=MOST_UNCERTAIN)

    def read(self, unit: str, at: Place) -> Noise:
        """Noise with its numbers in SI units.

        `unit`: SI unit of a standard deviation of the kind's noise. Raises `InputError` and `ConfigurationError` if a
        number has another unit or makes no sense; the message names the key.
        """
        sigma, relative = (None, 0.0) if self.sigma is None else _read_deviation(self.sigma, unit, at / "sigma")
        discrepancy = _read_number(self.discrepancy, unit, at / "discrepancy") if self.discrepancy else 0.0
        with locate_errors(at):
            return Noise(**dict(self) | {"sigma": sigma, "relative": relative, "discrepancy": discrepancy})


def _read_deviation(item: str | float | int, unit: str, at: Place) -> tuple[float, float]:
    """Standard deviation at a rate of zero and the share of the rate that is added, as in "0.02 mm3/ms + 1 %"."""
    first, plus, second = item.rpartition(" + ") if isinstance(item, str) else (item, "", "")
    if not plus:
        return _read_number(item, unit, at), 0.0
    if unit == "1":
        raise at.error(
            f'"{item}" has two parts, and a sigma here is a multiple of the tolerance; state one number, and the part '
            'that grows with the value as the key "relative" of the data set',
            code="two-parts",
        )
    if "%" not in second:
        raise at.error(
            f'the second part of "{item}" must be percent of the rate, as in "0.02 mm3/ms + 1 %"', code="not-percent"
        )
    return _read_number(first, unit, at), _read_number(second, "1", at)


def _read_number(item: str | float | int, unit: str, at: Place) -> float:
    with locate_errors(at):
        return parse(item, unit)
