"""Definition of a tolerance study: dimensions with their distributions, operating points with limits, trim."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Protocol

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, PlainValidator, ValidationInfo

from commonrail.base.arguments import (
    COUNTS,
    chosen,
    file_path,
    instance,
    instances,
    known_names,
    number,
    plain_text,
    settle,
    whole,
)
from commonrail.base.arrays import Floats
from commonrail.base.choices import Precision
from commonrail.base.errors import ConfigurationError, nearest
from commonrail.calibration.study_file.keys import InItsUnit, known_parameter
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.status import check_point
from commonrail.engine.time_step import DEFAULT_STEP, check_step
from commonrail.physics.injector import Injector, Source, parameter_quantities
from commonrail.readers.fields import UNSTATED, FileModel, Mark, Text, Unit, choice, fault
from commonrail.readers.injector.file import load_injector
from commonrail.readers.limits import Reach
from commonrail.readers.location import Place, located
from commonrail.readers.toml import read_model, read_toml

# Distributions of a dimension over parts, as values at shares of the parts.


class Distribution(Protocol):
    """Distribution of a dimension, SI."""

    def at(self, shares: Floats) -> Floats:
        """Value below which a share of the parts lies, for shares between 0 and 1."""

    def record(self) -> dict[str, Any]:
        """JSON-able form: kind and numbers."""


def _finite(values: dict[str, object], what: str) -> dict[str, float]:
    return {name: number(value, "1", f"{name} of {what}") for name, value in values.items()}


@dataclass(frozen=True)
class Normal:
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
        settle(self, **_finite({"mean": self.mean, "sigma": self.sigma}, "a normal distribution"))
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

    def record(self) -> dict[str, Any]:
        """As `Distribution`; a limit that is not there is None."""
        ends = {"lower": self.lower, "upper": self.upper}
        cut = {name: end if math.isfinite(end) else None for name, end in ends.items()}
        return {"kind": "normal", "mean": self.mean, "sigma": self.sigma, **cut}


@dataclass(frozen=True)
class Uniform:
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
        settle(self, **_finite({"lower": self.lower, "upper": self.upper}, "a uniform distribution"))
        if not self.lower < self.upper:
            raise ConfigurationError(
                f"The lower limit of a uniform distribution must be below the upper, not {self.lower:g} and "
                f"{self.upper:g}."
            )

    def at(self, shares: Floats) -> Floats:
        """As `Distribution`."""
        return np.asarray(self.lower + (self.upper - self.lower) * shares)

    def record(self) -> dict[str, Any]:
        """As `Distribution`."""
        return {"kind": "uniform", "lower": self.lower, "upper": self.upper}


@dataclass(frozen=True)
class Triangular:
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
        given = {"lower": self.lower, "mode": self.mode, "upper": self.upper}
        settle(self, **_finite(dict(given), "a triangular distribution"))
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

    def record(self) -> dict[str, Any]:
        """As `Distribution`."""
        return {"kind": "triangular", "lower": self.lower, "mode": self.mode, "upper": self.upper}


MOST_FIGURES = 50_000_000  # parts times operating points: 400 MB
NO_SOURCE = Source("E", "no source stated")
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
    source: Source = NO_SOURCE

    def __post_init__(self) -> None:
        known = parameter_quantities()
        if self.name not in known:
            raise ConfigurationError(f"There is no parameter {self.name}{nearest(self.name, known)}.")
        if self.name in COUNTS:
            raise ConfigurationError(f"{self.name} counts pieces, so it has no tolerance; omit it.")
        quantity = known[self.name]
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
class Trim:
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
    trim : Trim, optional
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
    trim: Trim | None = None
    parts: int = field(default=100_000, kw_only=True)
    seed: int = field(default=1, kw_only=True)
    sampling: Sampling = field(default=Sampling.QUASI_RANDOM, kw_only=True)
    time_step: float = field(default=DEFAULT_STEP, kw_only=True)
    precision: Precision = field(default=Precision.F64, kw_only=True)
    synthetic: str = field(default="", kw_only=True)
    text: str = field(default="", kw_only=True)

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


# Parts of a tolerance study: values of their dimensions, drawn one after the other.

EDGE = 1e-12  # distance of a share from 0 and 1, where a normal distribution has no value


class Draws:
    """Parts in order; the same study gives the same parts, however many are drawn at a time."""

    def __init__(self, tolerances: Tolerances) -> None:
        from scipy.stats import qmc  # slow to import

        rng = np.random.default_rng(tolerances.seed)
        self._dimensions, self._factor = tolerances.dimensions, tolerances.factor()
        d = len(self._dimensions)
        even = tolerances.sampling is Sampling.QUASI_RANDOM
        self._sequence = qmc.Sobol(d, rng=rng) if even else None
        self._rng = rng

    def take(self, count: int) -> Floats:
        """The next parts (count, dimensions) [SI]; a power of two each time keeps the sequence even."""
        shares = self._rng.random((count, len(self._dimensions))) if self._sequence is None else self._even(count)
        shares = np.clip(shares, EDGE, 1.0 - EDGE)
        if self._factor is not None:
            from scipy.special import ndtr, ndtri  # slow to import

            shares = np.clip(ndtr(ndtri(shares) @ self._factor.T), EDGE, 1.0 - EDGE)
        columns = [dimension.distribution.at(shares[:, j]) for j, dimension in enumerate(self._dimensions)]
        return np.stack(columns, axis=1)

    def _even(self, count: int) -> Floats:
        assert self._sequence is not None
        whole = 1 << (count - 1).bit_length()  # SciPy warns of numbers that are no powers of two
        if self._sequence.num_generated or whole == count:
            return np.asarray(self._sequence.random(count))
        return np.asarray(self._sequence.random(whole)[:count])


# Tolerance studies from TOML: injector, distributions of its dimensions, operating points with limits, trim.

MOST_DIMENSIONS = 200
MOST_POINTS = 100
MOST_CORRELATIONS = 1000


class _Width(NamedTuple):
    """Width in SI, or as a share of the drawing's value."""

    value: float
    relative: bool

    def about(self, drawn: float) -> float:
        """Width [SI] about a value of the drawing."""
        return abs(drawn) * self.value if self.relative else self.value


def _width(item: Any, info: ValidationInfo) -> _Width:
    """Width in percent of the drawing's value, or in the unit of the parameter."""
    if isinstance(item, str) and "%" in item:
        return _Width(Unit("%").read(item) / 100.0, True)
    name = info.data.get("name")
    return _Width(Unit(parameter_quantities()[name].unit).read(item) if name else 0.0, False)


def _limit(item: Any) -> Limit:
    """Limit as a quantity, or as its deviation from the nominal one in percent."""
    if isinstance(item, str) and "%" in item:
        return Limit(Unit("%").read(item) / 100.0, True)
    return Limit(Unit("m3").read(item))


def _in_order(item: Any) -> Any:
    """The table with its name first, whose unit the other keys have."""
    return {"name": item["name"], **item} if isinstance(item, dict) and "name" in item else item


_WidthField = Annotated[_Width, PlainValidator(_width)]
_LimitField = Annotated[Limit, PlainValidator(_limit)]


class _PointModel(FileModel):
    name: Text
    rail_pressure: Annotated[float, Unit("Pa")]
    energising_time: Annotated[float, Unit("s")]
    cylinder_pressure: Annotated[float, Unit("Pa")] = 5e6
    return_pressure: Annotated[float, Unit("Pa")] = 0.5e6
    lower: _LimitField | None = None
    upper: _LimitField | None = None


class _DimensionModel(FileModel):
    name: Annotated[str, AfterValidator(known_parameter)]
    distribution: Literal["normal", "uniform", "triangular"]
    mean: InItsUnit | None = None
    mode: InItsUnit | None = None
    sigma: _WidthField | None = None
    tolerance: _WidthField | None = None
    lower: InItsUnit | None = None
    upper: InItsUnit | None = None
    mark: Mark | None = None
    source: str | None = None


class _CorrelationModel(FileModel):
    between: list[str] = Field(min_length=2, max_length=2)
    value: float = Field(strict=False)


class _TrimModel(FileModel):
    points: list[str] = Field(min_length=1, max_length=2)
    parts: int = 8192
    resolution: Annotated[float, Unit("s")] = 1e-6
    scatter: Annotated[float, Unit("m3")] = 0.0


def _count(item: Any) -> int:
    if isinstance(item, bool) or not isinstance(item, int) or not 1000 <= item <= MOST_FIGURES:
        raise fault(f"this must be a whole number from 1000 to {MOST_FIGURES}, not {item!r}")
    return item


class _ToleranceModel(FileModel):
    """The whole file."""

    format: Literal["commonrail-tolerance/1"]
    title: Text
    synthetic: str = ""
    allow_outside: bool = False
    injector: Text
    parts: Annotated[int, PlainValidator(_count)] = 100_000
    seed: int = Field(default=1, ge=0)
    sampling: Annotated[Sampling, choice(Sampling)] = Sampling.QUASI_RANDOM
    time_step: Annotated[float, Unit("s")] = DEFAULT_STEP
    precision: Annotated[Precision, choice(Precision)] = Precision.F64
    mark: Mark = UNSTATED.mark
    source: str = UNSTATED.text
    point: list[_PointModel] = Field(min_length=1, max_length=MOST_POINTS)
    dimension: list[Annotated[_DimensionModel, BeforeValidator(_in_order)]] = Field(
        min_length=1, max_length=MOST_DIMENSIONS
    )
    correlation: list[_CorrelationModel] = Field(default=[], max_length=MOST_CORRELATIONS)
    trim: _TrimModel | None = None


def load_tolerances(path: str | Path) -> Tolerances:
    """Read a tolerance study with its injector.

    Parameters
    ----------
    path : str or Path
        TOML file; the injector is a name of the catalogue, or a file in its folder or below unless the file says
        ``allow_outside = true``.

    Raises
    ------
    InputError
        If a file cannot be read, or something in it is unknown, missing or of the wrong kind.
    ConfigurationError
        If `path` is no path, or values contradict one another.
    """
    file = file_path(path, "path of a tolerance study")
    document, text = read_toml(file)
    at = Place(str(file))
    model = read_model(_ToleranceModel, document, at)
    injector = _injector(model, file, at / "injector")
    dimensions = []
    for i, item in enumerate(model.dimension):
        with located((at / "dimension")[i]):
            source = Source(item.mark or model.mark, model.source if item.source is None else item.source)
            dimensions.append(Dimension(item.name, _distribution(item, injector.values[item.name]), source))
    points = []
    for i, given in enumerate(model.point):
        with located((at / "point")[i]):
            points.append(_point(given, injector))
    with located(at):
        return Tolerances(
            model.title,
            injector,
            tuple(dimensions),
            tuple(points),
            tuple(Correlation(c.between[0], c.between[1], c.value) for c in model.correlation),
            None if model.trim is None else Trim(**(dict(model.trim) | {"points": tuple(model.trim.points)})),
            parts=model.parts,
            seed=model.seed,
            sampling=model.sampling,
            time_step=model.time_step,
            precision=model.precision,
            synthetic=model.synthetic,
            text=text,
        )


def _injector(model: _ToleranceModel, file: Path, at: Place) -> Injector:
    reach = Reach(file, model.allow_outside)
    if model.injector.endswith(".toml"):
        return load_injector(reach.path(file.parent, model.injector, at), reach)
    with located(at):
        return load_injector(model.injector, reach)


def _point(given: _PointModel, injector: Injector) -> TolerancePoint:
    point = OperatingPoint(given.rail_pressure, given.energising_time, given.cylinder_pressure, given.return_pressure)
    check_point(injector, point)
    return TolerancePoint(given.name, point, given.lower, given.upper)


# Keys that a distribution takes besides name, mark and source.
_KEYS = {
    "normal": ("mean", "sigma", "tolerance", "lower", "upper"),
    "uniform": ("mean", "tolerance", "lower", "upper"),
    "triangular": ("mode", "tolerance", "lower", "upper"),
}


def _distribution(item: _DimensionModel, drawn: float) -> Distribution:
    """Distribution about the drawing's value, or about the one that is given."""
    for key in ("mean", "mode", "sigma", "tolerance", "lower", "upper"):
        if getattr(item, key) is not None and key not in _KEYS[item.distribution]:
            raise ConfigurationError(
                f'a {item.distribution} distribution has no key "{key}"; it can have '
                f"{', '.join(_KEYS[item.distribution])}"
            )
    middle = next((value for value in (item.mean, item.mode) if value is not None), drawn)
    low, high = _ends(item, middle, drawn)
    if item.distribution == "normal":
        if item.sigma is None:
            raise ConfigurationError('a normal distribution needs "sigma", its standard deviation')
        ends = {name: end for name, end in (("lower", low), ("upper", high)) if end is not None}
        return Normal(middle, item.sigma.about(drawn), **ends)
    if low is None or high is None:
        raise ConfigurationError(f'a {item.distribution} distribution needs "tolerance", or "lower" and "upper"')
    return Uniform(low, high) if item.distribution == "uniform" else Triangular(low, middle, high)


def _ends(item: _DimensionModel, middle: float, drawn: float) -> tuple[float | None, float | None]:
    """Limits of the distribution: about its middle, or outright."""
    if item.tolerance is None:
        return item.lower, item.upper
    if item.lower is not None or item.upper is not None:
        raise ConfigurationError('give "tolerance", or "lower" and "upper", not both')
    reach = item.tolerance.about(drawn)
    return middle - reach, middle + reach
