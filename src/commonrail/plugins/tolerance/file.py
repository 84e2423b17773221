"""Files of a tolerance study: record and table of the result, and the TOML file of the study."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import AfterValidator, Field, PlainValidator, ValidationInfo

from commonrail.base.arguments import file_path
from commonrail.base.choices import Precision
from commonrail.base.display import Shown
from commonrail.base.errors import ConfigurationError
from commonrail.base.record import Interval, Key
from commonrail.calibration.study_file import named_injector
from commonrail.calibration.study_keys import InItsUnit, known_parameter
from commonrail.data.records import make_record
from commonrail.engine.operating_point import Energising, OperatingPoint
from commonrail.engine.status import check_point
from commonrail.engine.time_step import DEFAULT_STEP
from commonrail.physics.injector import Injector, Source, parameter_quantities
from commonrail.plugins.tolerance.statistics import Shares, Spread
from commonrail.plugins.tolerance.study import (
    MOST_FIGURES,
    Correlation,
    Dimension,
    Distribution,
    Limit,
    Normal,
    Sampling,
    SeriesTrim,
    TolerancePoint,
    Tolerances,
    Triangular,
    Uniform,
)
from commonrail.plugins.tolerance.trim import Trimmed
from commonrail.readers.location import locate_errors
from commonrail.readers.toml import UNSTATED, FileModel, Mark, Sourced, Text, Unit, choice, fault, read_model_file


class DimensionShare(NamedTuple):
    """Share of a dimension in the variance at a point (see `Shares`); None if nothing scatters.

    `if_halved` is the standard deviation of the quantity if this dimension alone scattered half as much [m³].
    """

    name: str
    share: Interval | None
    swing: float | None
    if_halved: float | None


class PointResult(NamedTuple):
    """Quantity as drawn [m³], spread, and shares of the variance in order of size at one operating point."""

    name: str
    rail_pressure: float
    energisings: tuple[Energising, ...]
    nominal: float
    spread: Spread
    dimensions: tuple[DimensionShare, ...]
    rest: float | None

    @classmethod
    def of(
        cls, point: TolerancePoint, nominal: float, spread: Spread, names: Sequence[str], shares: Shares | None
    ) -> PointResult:
        """Result at a point of a study; `names`: of its dimensions."""
        rows = [DimensionShare(name, None, None, None) for name in names]
        if shares is not None:
            ends = np.stack([shares.value, shares.low, shares.high], axis=1).tolist()
            others = zip(names, ends, shares.swing.tolist(), shares.halved.tolist(), strict=True)
            rows = [DimensionShare(name, Interval(*share), swing, halved) for name, share, swing, halved in others]
            rows = [rows[int(j)] for j in np.argsort(-shares.value, kind="stable")]
        at = point.point
        rest = None if shares is None else shares.rest
        return cls(point.name, at.at_start(at.rail_pressure), tuple(at.pulses), nominal, spread, tuple(rows), rest)


class InjectorFacts(NamedTuple):
    """Injector of a study."""

    name: str
    title: str
    variant: str


class DistributionFacts(NamedTuple):
    """Distribution of a dimension: kind and numbers [SI]; None for an absent limit."""

    kind: str
    lower: float | None
    upper: float | None
    mean: float | None = None
    sigma: float | None = None
    mode: float | None = None


class DimensionFacts(NamedTuple):
    """Dimension of a study: value of the drawing [SI], and distribution with its mark and source."""

    name: str
    unit: str
    drawn: float
    distribution: DistributionFacts
    mark: str
    source: str

    @classmethod
    def of(cls, dimension: Dimension, injector: Injector) -> DimensionFacts:
        """Facts of a dimension of an injector."""
        law, (mark, source) = dimension.distribution, dimension.source
        numbers = {name: end if math.isfinite(end) else None for name, end in vars(law).items()}
        unit, drawn = parameter_quantities()[dimension.name].unit, injector.values[dimension.name]
        return cls(dimension.name, unit, drawn, DistributionFacts(law.kind, **numbers), mark, source)


@dataclass(frozen=True, repr=False)
class ToleranceResult(Shown):
    """Result of a tolerance study.

    Attributes
    ----------
    title : str
    synthetic : str
        Assumed parts of injector and tolerances; empty if nothing is assumed.
    injector : InjectorFacts
    status : str
        "complete", or "interrupted": the result covers the parts simulated so far.
    asked, parts : int
        Number of parts asked for, and simulated.
    injections : int
        Number of single simulations.
    seed, sampling, time_step, precision
        Those of the study.
    confidence : float
        Probability of the intervals.
    dimensions : tuple of DimensionFacts
    correlations : tuple of Correlation
    points : tuple of PointResult
    trim : Trimmed or None
    seconds : float
    """

    presenter = "commonrail.plugins.tolerance.page:TOLERANCE"

    title: str
    synthetic: str
    injector: InjectorFacts
    status: str
    asked: int
    parts: int
    injections: int
    seed: int
    sampling: Sampling
    time_step: float
    precision: Precision
    confidence: float
    dimensions: tuple[DimensionFacts, ...]
    correlations: tuple[Correlation, ...]
    points: tuple[PointResult, ...]
    trim: Trimmed | None
    seconds: Annotated[float, Key("clock.seconds")]

    def rows(self) -> list[dict[str, Any]]:
        """One flat row for each operating point and dimension [SI], for ``pandas.DataFrame(rows)``."""
        rows = []
        for point in self.points:
            spread = point.spread
            head = {"point": point.name, "nominal": point.nominal, "mean": spread.mean}
            head |= {"deviation": spread.deviation, "out": spread.out.value}
            for row in point.dimensions:
                value, low, high = row.share or (None, None, None)
                share = {"share": value, "share_low": low, "share_high": high}
                rows.append({**head, "dimension": row.name, **share, "swing": row.swing, "if_halved": row.if_halved})
        return rows

    def record(self) -> dict[str, Any]:
        """JSON-able form, SI; what does not exist is None."""
        return make_record("tolerance", self)


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


def _read(item: Any, unit: str) -> tuple[float, bool]:
    """Value, and whether it is a share (given in percent) or a number in an SI unit."""
    relative = isinstance(item, str) and "%" in item
    return Unit("1" if relative else unit).read(item), relative


def _width(item: Any, info: ValidationInfo) -> _Width:
    """Width in percent of the drawing's value, or in the unit of the parameter."""
    name = info.data.get("name")
    return _Width(*_read(item, parameter_quantities()[name].unit)) if name else _Width(0.0, False)


def _limit(item: Any) -> Limit:
    """Limit as a quantity, or as a deviation from the nominal quantity in percent."""
    return Limit(*_read(item, "m3"))


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


class _DimensionModel(Sourced):
    name: Annotated[str, AfterValidator(known_parameter)]
    distribution: Literal["normal", "uniform", "triangular"]
    mean: InItsUnit | None = None
    mode: InItsUnit | None = None
    sigma: _WidthField | None = None
    tolerance: _WidthField | None = None
    lower: InItsUnit | None = None
    upper: InItsUnit | None = None


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
    dimension: list[_DimensionModel] = Field(min_length=1, max_length=MOST_DIMENSIONS)
    correlation: list[_CorrelationModel] = Field(default=[], max_length=MOST_CORRELATIONS)
    trim: _TrimModel | None = None


def load_tolerances(path: str | Path) -> Tolerances:
    """Read a tolerance study with its injector.

    Parameters
    ----------
    path : str or Path
        TOML file. The injector is a name of the catalogue or a file in the same folder or a subfolder; other places
        need ``allow_outside = true``.

    Raises
    ------
    InputError
        If a file cannot be read, or something in it is unknown, missing or of the wrong kind.
    ConfigurationError
        If `path` is not a path, or values contradict one another.
    """
    file = file_path(path, "path of a tolerance study")
    model, at, reach, text = read_model_file(_ToleranceModel, file)
    injector = named_injector(model.injector, file.parent, reach, at / "injector")
    dimensions = []
    for i, item in enumerate(model.dimension):
        with locate_errors((at / "dimension")[i]):
            distribution = _distribution(item, injector.values[item.name])
            dimensions.append(Dimension(item.name, distribution, item.origin(Source(model.mark, model.source))))
    points = []
    for i, point_model in enumerate(model.point):
        with locate_errors((at / "point")[i]):
            points.append(_point(point_model, injector))
    with locate_errors(at):
        return Tolerances(
            model.title,
            injector,
            tuple(dimensions),
            tuple(points),
            tuple(Correlation(c.between[0], c.between[1], c.value) for c in model.correlation),
            None if model.trim is None else SeriesTrim(**(dict(model.trim) | {"points": tuple(model.trim.points)})),
            parts=model.parts,
            seed=model.seed,
            sampling=model.sampling,
            time_step=model.time_step,
            precision=model.precision,
            synthetic=model.synthetic,
            text=text,
        )


def _point(point_model: _PointModel, injector: Injector) -> TolerancePoint:
    point = OperatingPoint(
        point_model.rail_pressure,
        point_model.energising_time,
        point_model.cylinder_pressure,
        point_model.return_pressure,
    )
    check_point(injector, point)
    return TolerancePoint(point_model.name, point, point_model.lower, point_model.upper)


# Keys of a distribution in addition to name, mark and source.
_KEYS = {
    "normal": ("mean", "sigma", "tolerance", "lower", "upper"),
    "uniform": ("mean", "tolerance", "lower", "upper"),
    "triangular": ("mode", "tolerance", "lower", "upper"),
}


def _distribution(item: _DimensionModel, drawn: float) -> Distribution:
    """Distribution about the stated value, by default the drawing's."""
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
    """Limits of the distribution, as stated or from the tolerance about its middle."""
    if item.tolerance is None:
        return item.lower, item.upper
    if item.lower is not None or item.upper is not None:
        raise ConfigurationError('give "tolerance", or "lower" and "upper", not both')
    reach = item.tolerance.about(drawn)
    return middle - reach, middle + reach
