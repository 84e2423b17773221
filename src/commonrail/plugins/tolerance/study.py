"""Definition of a tolerance study: dimensions with distributions, operating points with limits, trim."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np

from commonrail.base.arguments import (
    COUNTS,
    TIME_STEPS,
    Limits,
    instance,
    known_names,
    number,
    plain_text,
    sequence,
    settle,
)
from commonrail.base.arrays import Floats
from commonrail.base.choices import Precision
from commonrail.base.declare import Choice, Number, Setting, setting, settings
from commonrail.base.errors import ConfigurationError, nearest
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.time_step import DEFAULT_STEP
from commonrail.physics.injector import Injector, Source, parameter_quantities
from commonrail.readers.toml import UNSTATED

# Distributions of a dimension over parts, by their quantiles.


class Distribution(ABC):
    """Distribution of a dimension: a data class of numbers [SI]."""

    @abstractmethod
    def at(self, shares: Floats) -> Floats:
        """Quantiles at shares between 0 and 1."""

    @property
    def kind(self) -> str:
        """Name of the distribution, such as "normal"."""
        return type(self).__name__.lower()

    def _read(self, *names: str) -> None:
        """Refuse numbers that are not finite."""
        settle(self, **{n: number(getattr(self, n), "1", f"{n} of a {self.kind} distribution") for n in names})


@dataclass(frozen=True)
class Normal(Distribution):
    """Normal distribution, optionally cut at limits: parts beyond them are sorted out.

    Parameters
    ----------
    mean, sigma : float
        Mean and standard deviation before the cut; sigma is greater than zero.
    lower, upper : float
        Limits of the cut; infinite: not cut.

    Raises
    ------
    ConfigurationError
        If a number is not finite, sigma is not positive, or no part lies between the limits.
    """

    mean: float
    sigma: float
    lower: float = -math.inf
    upper: float = math.inf

    def __post_init__(self) -> None:
        self._read("mean", "sigma")
        if not self.sigma > 0.0:
            raise ConfigurationError(
                f"The sigma of a normal distribution must be greater than zero, not {self.sigma:g}."
            )
        if not self.lower < self.upper or not self._span[1] > self._span[0]:
            raise ConfigurationError(
                f"A normal distribution with mean {self.mean:g} and sigma {self.sigma:g} has no part between "
                f"{self.lower:g} and {self.upper:g}; correct the limits."
            )

    @property
    def _span(self) -> tuple[float, float]:
        """Shares of the uncut distribution below the limits."""
        from scipy.special import ndtr  # slow to import

        low, high = (float(ndtr((end - self.mean) / self.sigma)) for end in (self.lower, self.upper))
        return low, high

    def at(self, shares: Floats) -> Floats:
        """As `Distribution`."""
        from scipy.special import ndtri  # slow to import

        low, high = self._span
        values = self.mean + self.sigma * ndtri(low + (high - low) * shares)
        return np.asarray(np.clip(values, self.lower, self.upper))


@dataclass(frozen=True)
class Uniform(Distribution):
    """Uniform distribution between two limits.

    Parameters
    ----------
    lower, upper : float

    Raises
    ------
    ConfigurationError
        If a limit is not finite, or the limits are crossed.
    """

    lower: float
    upper: float

    def __post_init__(self) -> None:
        self._read("lower", "upper")
        if not self.lower < self.upper:
            raise ConfigurationError(
                f"The lower limit of a uniform distribution must be below the upper, not {self.lower:g} and "
                f"{self.upper:g}."
            )

    def at(self, shares: Floats) -> Floats:
        """As `Distribution`."""
        return np.asarray(self.lower + (self.upper - self.lower) * shares)


@dataclass(frozen=True)
class Triangular(Distribution):
    """Triangular distribution between two limits, most parts at the mode.

    Parameters
    ----------
    lower, mode, upper : float
        In rising order; the mode may equal a limit.

    Raises
    ------
    ConfigurationError
        If a number is not finite, or they are not in order.
    """

    lower: float
    mode: float
    upper: float

    def __post_init__(self) -> None:
        self._read("lower", "mode", "upper")
        if not (self.lower <= self.mode <= self.upper and self.lower < self.upper):
            raise ConfigurationError(
                f"The mode of a triangular distribution must lie between its limits, not {self.mode:g} between "
                f"{self.lower:g} and {self.upper:g}."
            )

    def at(self, shares: Floats) -> Floats:
        """As `Distribution`."""
        width = self.upper - self.lower
        rising = self.lower + np.sqrt(shares * width) * np.sqrt(self.mode - self.lower)
        falling = self.upper - np.sqrt((1.0 - shares) * width) * np.sqrt(self.upper - self.mode)
        return np.asarray(np.where(shares * width < self.mode - self.lower, rising, falling))


MOST_FIGURES = 50_000_000  # parts times operating points: 400 MB
RARE = 1e-4  # share of the parts that may lie outside a dimension's domain


class Sampling(Enum):
    """Method of drawing parts: an even, scrambled Sobol' sequence, or independent random numbers."""

    QUASI_RANDOM = "quasi-random"
    RANDOM = "random"


@dataclass(frozen=True)
class Dimension:
    """A dimension that scatters from part to part.

    Parameters
    ----------
    name : str
        Name of a parameter, such as "valve.lift".
    distribution : Distribution
        [SI].
    source : Source
        Mark and origin of the distribution.

    Raises
    ------
    ConfigurationError
        If the parameter is unknown, or more than `RARE` of the parts lie outside its domain.
    """

    name: str
    distribution: Distribution
    source: Source = UNSTATED

    def __post_init__(self) -> None:
        parameters = parameter_quantities()
        if plain_text(self.name, "name of a parameter") not in parameters:
            raise ConfigurationError(f"Unknown parameter {self.name}{nearest(self.name, parameters)}.")
        if self.name in COUNTS:
            raise ConfigurationError(f"{self.name} is a count and cannot have a tolerance; omit it.")
        quantity = parameters[self.name]
        instance(self.distribution, Distribution, f"distribution of {self.name}")  # type: ignore[type-abstract]
        ends = self.distribution.at(np.array([RARE, 1.0 - RARE]))
        if not quantity.domain.admits(ends).all():
            raise ConfigurationError(
                f"{self.name}: more than {RARE:g} of the parts lie outside its domain ({quantity.domain.value}); "
                "reduce the spread, or cut the distribution."
            )


class Limit(NamedTuple):
    """Limit of a quantity: [m³], or a relative deviation from the nominal quantity."""

    value: float
    relative: bool = False

    def at(self, nominal: float) -> float:
        """Limit [m³] for a nominal quantity."""
        return nominal * (1.0 + self.value) if self.relative else self.value


@dataclass(frozen=True)
class TolerancePoint:
    """An operating point, and the limits of the quantity there.

    Parameters
    ----------
    name : str
    point : OperatingPoint
    lower, upper : Limit, optional
    """

    name: str
    point: OperatingPoint
    lower: Limit | None = None
    upper: Limit | None = None

    def __post_init__(self) -> None:
        plain_text(self.name, "name of an operating point")
        instance(self.point, OperatingPoint, f"operating point {self.name}")


class Correlation(NamedTuple):
    """Correlation of the normal scores of two dimensions, between −1 and 1."""

    first: str
    second: str
    value: float


def _test_points(value: object, words: str) -> tuple[str, ...]:
    points = tuple(sequence(value, words, '["VL", "LL"]'))
    if len(points) not in (1, 2) or len(set(points)) != len(points):
        raise ConfigurationError(f"A trim needs one or two operating points, not {len(points)}.")
    return points


@settings(kw_only=False)
class SeriesTrim:
    """Correction of each part's energising time from quantities measured on it.

    One test point gives the same correction at all points; two give a correction linear in the energising time.
    `ConfigurationError` for another number of points, or a number beyond its limits.
    """

    points: Setting[tuple[str, ...], Sequence[str]] = setting(
        words="points of a trim", read=_test_points, text="Names of the one or two points where each part is measured."
    )
    parts: int = setting(
        words="number of parts of the trim",
        default=8192,
        limits=Limits(100, 1_000_000),
        text="Parts that are trimmed and simulated again.",
    )
    resolution: Number = setting(
        words="resolution of the trim",
        unit="s",
        default=1e-6,
        limits=Limits(1e-8, 1e-4),
        text="Step of the energising time.",
    )
    scatter: Number = setting(
        words="scatter of the trim",
        unit="m3",
        default=0.0,
        limits=Limits(0.0, 1e-6),
        text="Standard deviation of a measured quantity.",
    )


@settings(kw_only=False)
class Tolerances:
    """A tolerance study, ready to run.

    `ConfigurationError` if an argument has the wrong type, names are unknown or repeated, correlations are
    inconsistent, or the quantities would not fit the memory.
    """

    title: str = setting(words="title of a tolerance study")
    injector: Injector = setting(
        words="injector of a tolerance study",
        text="As drawn: gives the nominal values, and those of dimensions that do not scatter.",
    )
    dimensions: Setting[tuple[Dimension, ...], Sequence[Dimension]] = setting(text="At least one, each name once.")
    points: Setting[tuple[TolerancePoint, ...], Sequence[TolerancePoint]] = setting(
        text="At least one, each name once."
    )
    correlations: Setting[tuple[Correlation, ...], Sequence[Correlation]] = setting(default=())
    trim: SeriesTrim | None = None
    _: KW_ONLY
    parts: int = setting(words="number of parts", default=100_000, limits=Limits(1000, MOST_FIGURES))
    seed: int = setting(default=1)
    sampling: Choice[Sampling] = setting(default=Sampling.QUASI_RANDOM)
    time_step: Number = setting(unit="s", default=DEFAULT_STEP, limits=TIME_STEPS)
    precision: Choice[Precision] = setting(default=Precision.F64)
    synthetic: str = setting(
        words="note on what is synthetic", default="", text="What is assumed about the tolerances; empty if nothing."
    )
    text: str = setting(words="text of a tolerance study", default="", text="The file it was read from.")

    def __post_init__(self) -> None:
        if not self.dimensions or not self.points:
            raise ConfigurationError("A tolerance study needs at least one dimension and one operating point.")
        known_names(self.names, parameter_quantities(), "dimensions", "nozzle.hole_diameter")
        labels = self.names_of_points
        if len(set(labels)) != len(labels):
            raise ConfigurationError("Two operating points have the same name; rename one.")
        if self.parts * len(self.points) > MOST_FIGURES:
            raise ConfigurationError(
                f"{self.parts:,} parts at {len(self.points)} operating points are more than {MOST_FIGURES:,} "
                "quantities; take fewer parts or points."
            )
        self._check_trim(labels)
        self.factor()  # refuses inconsistent correlations

    def _check_trim(self, labels: tuple[str, ...]) -> None:
        if self.trim is None:
            return
        for name in self.trim.points:
            if name not in labels:
                raise ConfigurationError(f"The trim names an unknown operating point {name}{nearest(name, labels)}.")
        if any(len(p.point.pulses) != 1 for p in self.points):
            raise ConfigurationError("A trim corrects single energisings; omit the trim, or the points with several.")
        times = [self.point(name).point.pulses[0].duration for name in self.trim.points]
        if len(times) == 2 and not abs(times[1] - times[0]) >= 0.1 * max(times):
            raise ConfigurationError("The two points of a trim must differ by 10 % or more in energising time.")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the dimensions."""
        return tuple(dimension.name for dimension in self.dimensions)

    @property
    def names_of_points(self) -> tuple[str, ...]:
        """Names of the operating points."""
        return tuple(p.name for p in self.points)

    def point(self, name: str) -> TolerancePoint:
        """Operating point of that name."""
        return next(p for p in self.points if p.name == name)

    def factor(self) -> Floats | None:
        """Cholesky factor (d, d) of the correlations of normal scores; None if all are independent."""
        if not self.correlations:
            return None
        matrix = np.eye(len(self.names))
        for first, second, value in self.correlations:
            for name in (first, second):
                if name not in self.names:
                    raise ConfigurationError(
                        f"A correlation names an unknown dimension {name}{nearest(name, self.names)}."
                    )
            if first == second or not abs(value) < 1.0:
                raise ConfigurationError(
                    f"The correlation of {first} and {second} must relate two dimensions and lie between -1 and 1, not "
                    f"{value:g}."
                )
            i, j = self.names.index(first), self.names.index(second)
            matrix[i, j] = matrix[j, i] = value
        try:
            return np.asarray(np.linalg.cholesky(matrix))
        except np.linalg.LinAlgError as error:
            raise ConfigurationError(
                "The correlations are inconsistent: their matrix is not positive definite; lower one of them."
            ) from error
