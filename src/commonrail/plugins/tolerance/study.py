"""Definition of a tolerance study: dimensions with their distributions, operating points with limits, trim."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import KW_ONLY, dataclass
from enum import Enum
from typing import Any, NamedTuple

import numpy as np

from commonrail.base.arguments import (
    COUNTS,
    chosen,
    instance,
    instances,
    known_names,
    number,
    plain_text,
    sequence,
    settle,
    whole,
)
from commonrail.base.arrays import Floats
from commonrail.base.choices import Precision
from commonrail.base.errors import ConfigurationError, nearest
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.time_step import DEFAULT_STEP, check_step
from commonrail.physics.injector import Injector, Source, parameter_quantities
from commonrail.readers.toml import UNSTATED

# Distributions of a dimension over parts, as values at shares of the parts.


class Distribution(ABC):
    """Distribution of a dimension, a data class of numbers [SI]."""

    @abstractmethod
    def at(self, shares: Floats) -> Floats:
        """Value below which a share of the parts lies, for shares between 0 and 1."""

    @property
    def kind(self) -> str:
        """Name of the distribution, such as "normal"."""
        return type(self).__name__.lower()

    def record(self) -> dict[str, Any]:
        """JSON-able form: kind and numbers, None for an infinite one."""
        return {"kind": self.kind} | {name: end if math.isfinite(end) else None for name, end in vars(self).items()}

    def _read(self, *names: str) -> None:
        """Refuse numbers that are not finite."""
        settle(self, **{n: number(getattr(self, n), "1", f"{n} of a {self.kind} distribution") for n in names})


@dataclass(frozen=True)
class Normal(Distribution):
    """Normal distribution, cut at two limits if they are given: parts beyond them are sorted out.

    Parameters
    ----------
    mean, sigma : float
        Mean and standard deviation before the cut; sigma is greater than zero.
    lower, upper : float
        Limits of the cut, infinite for none.

    Raises
    ------
    ConfigurationError
        If a number is not finite, sigma is not greater than zero, or nothing is left between the limits.
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
                f"A normal distribution with mean {self.mean:g} and sigma {self.sigma:g} has nothing between "
                f"{self.lower:g} and {self.upper:g}; correct the limits."
            )

    @property
    def _span(self) -> tuple[float, float]:
        """Shares of the uncut distribution below its limits."""
        from scipy.special import ndtr  # slow to import

        low, high = (float(ndtr((end - self.mean) / self.sigma)) for end in (self.lower, self.upper))
        return low, high

    def at(self, shares: Floats) -> Floats:
        """As `Distribution`."""
        from scipy.special import ndtri  # slow to import

        low, high = self._span
        found = self.mean + self.sigma * ndtri(low + (high - low) * shares)
        return np.asarray(np.clip(found, self.lower, self.upper))


@dataclass(frozen=True)
class Uniform(Distribution):
    """Uniform distribution between two limits.

    Parameters
    ----------
    lower, upper : float

    Raises
    ------
    ConfigurationError
        If a limit is not finite, or they are crossed.
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
        In rising order; the mode may be a limit.

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
    """Drawing of parts: an even, scrambled Sobol' sequence, or independent random numbers."""

    QUASI_RANDOM = "quasi-random"
    RANDOM = "random"


@dataclass(frozen=True)
class Dimension:
    """A dimension that scatters from part to part.

    Parameters
    ----------
    name : str
        Dotted name of a parameter.
    distribution : Distribution
        [SI].
    source : Source
        Mark and origin of the distribution.

    Raises
    ------
    ConfigurationError
        If there is no such parameter, or more than `RARE` of the parts lie outside its domain.
    """

    name: str
    distribution: Distribution
    source: Source = UNSTATED

    def __post_init__(self) -> None:
        known = parameter_quantities()
        if plain_text(self.name, "name of a parameter") not in known:
            raise ConfigurationError(f"There is no parameter {self.name}{nearest(self.name, known)}.")
        if self.name in COUNTS:
            raise ConfigurationError(f"{self.name} counts pieces, so it has no tolerance; omit it.")
        quantity = known[self.name]
        instance(self.distribution, Distribution, f"distribution of {self.name}")  # type: ignore[type-abstract]
        ends = self.distribution.at(np.array([RARE, 1.0 - RARE]))
        if not quantity.domain.admits(ends).all():
            raise ConfigurationError(
                f"{self.name}: more than {RARE:g} of the parts lie outside its domain ({quantity.domain.value}); "
                "take a smaller spread, or cut the distribution."
            )


class Limit(NamedTuple):
    """Limit of a quantity: [m³], or as a share of the nominal quantity by which it may deviate."""

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
    """Correlation of two dimensions, of their normal scores: between −1 and 1."""

    first: str
    second: str
    value: float


@dataclass(frozen=True)
class SeriesTrim:
    """Correction of each part's energising time from quantities that are measured on it.

    Parameters
    ----------
    points : sequence of str
        Names of one or two operating points at which each part is measured. With one, the correction is the same at
        all points; with two, linear in the energising time.
    parts : int
        Number of parts that are trimmed and simulated again.
    resolution : float or str
        Step of the energising time [s].
    scatter : float or str
        Standard deviation of a measured quantity [m³].

    Raises
    ------
    ConfigurationError
        If there are not one or two points, or a number is beyond its limits.
    """

    points: tuple[str, ...]
    parts: int = 8192
    resolution: float = 1e-6
    scatter: float = 0.0

    def __post_init__(self) -> None:
        sequence(self.points, "points of a trim", '["VL", "LL"]')
        if len(self.points) not in (1, 2) or len(set(self.points)) != len(self.points):
            raise ConfigurationError(f"A trim needs one or two operating points, not {len(self.points)}.")
        settle(
            self,
            points=tuple(self.points),
            parts=whole(self.parts, "number of parts of the trim", 100, 1_000_000),
            resolution=number(self.resolution, "s", "resolution of the trim"),
            scatter=number(self.scatter, "m3", "scatter of the trim"),
        )
        if not 1e-8 <= self.resolution <= 1e-4 or self.scatter < 0.0:
            raise ConfigurationError(
                "The resolution of a trim must lie between 10 ns and 100 us, its scatter not below 0."
            )


@dataclass(frozen=True)
class Tolerances:
    """A tolerance study, ready to run.

    Parameters
    ----------
    title : str
    injector : Injector
        As drawn: its values are nominal, and those of dimensions that do not scatter.
    dimensions : sequence of Dimension
        At least one, each name once.
    points : sequence of TolerancePoint
        At least one, each name once.
    correlations : sequence of Correlation
    trim : SeriesTrim, optional
    parts : int
        Number of parts, from 1000.
    seed : int
    sampling : Sampling or str
        "quasi-random" or "random".
    time_step : float or str
        [s].
    precision : Precision or str
        "f64" or "f32".
    synthetic : str
        What about the tolerances is assumed; empty if nothing.
    text : str
        The file it was read from.

    Raises
    ------
    ConfigurationError
        If an argument is of another kind, names are unknown or repeated, correlations cannot hold together, or the
        figures would not fit the memory.
    """

    title: str
    injector: Injector
    dimensions: tuple[Dimension, ...]
    points: tuple[TolerancePoint, ...]
    correlations: tuple[Correlation, ...] = ()
    trim: SeriesTrim | None = None
    _: KW_ONLY
    parts: int = 100_000
    seed: int = 1
    sampling: Sampling = Sampling.QUASI_RANDOM
    time_step: float = DEFAULT_STEP
    precision: Precision = Precision.F64
    synthetic: str = ""
    text: str = ""

    def __post_init__(self) -> None:
        for what in ("title", "synthetic", "text"):
            plain_text(getattr(self, what), f"{what} of a tolerance study")
        instance(self.injector, Injector, "injector of a tolerance study")
        settle(
            self,
            dimensions=instances(self.dimensions, Dimension, "dimensions"),
            points=instances(self.points, TolerancePoint, "points"),
            correlations=tuple(self.correlations),
            parts=whole(self.parts, "number of parts", 1000, MOST_FIGURES),
            seed=whole(self.seed, "seed"),
            sampling=chosen(self.sampling, Sampling, "sampling"),
            time_step=check_step(self.time_step),
            precision=chosen(self.precision, Precision, "precision"),
        )
        if not self.dimensions or not self.points:
            raise ConfigurationError("A tolerance study needs at least one dimension and one operating point.")
        known_names(self.names, parameter_quantities(), "dimensions", "nozzle.hole_diameter")
        labels = self.names_of_points
        if len(set(labels)) != len(labels):
            raise ConfigurationError("The operating points of a tolerance study need names of their own.")
        if self.parts * len(self.points) > MOST_FIGURES:
            raise ConfigurationError(
                f"{self.parts:,} parts at {len(self.points)} operating points are more than {MOST_FIGURES:,} "
                "quantities; take fewer parts or points."
            )
        self._check_trim(labels)
        self.factor()  # refuses correlations that cannot hold together

    def _check_trim(self, labels: tuple[str, ...]) -> None:
        if self.trim is None:
            return
        for name in self.trim.points:
            if name not in labels:
                raise ConfigurationError(f"The trim names no operating point {name}{nearest(name, labels)}.")
        if any(len(p.point.pulses) != 1 for p in self.points):
            raise ConfigurationError("A trim corrects a single energising; omit the trim, or the points with several.")
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
        """Cholesky factor (d, d) of the correlations of normal scores; None where all are independent."""
        if not self.correlations:
            return None
        matrix = np.eye(len(self.names))
        for first, second, value in self.correlations:
            for name in (first, second):
                if name not in self.names:
                    raise ConfigurationError(f"A correlation names no dimension {name}{nearest(name, self.names)}.")
            if first == second or not abs(value) < 1.0:
                raise ConfigurationError(
                    f"The correlation of {first} and {second} must be of two dimensions and lie between -1 and 1, not "
                    f"{value:g}."
                )
            i, j = self.names.index(first), self.names.index(second)
            matrix[i, j] = matrix[j, i] = value
        try:
            return np.asarray(np.linalg.cholesky(matrix))
        except np.linalg.LinAlgError as error:
            raise ConfigurationError(
                "The correlations cannot hold together: two dimensions that go with a third must go with each other; "
                "lower one of them."
            ) from error
