"""Tolerance studies from TOML: injector, distributions of its dimensions, operating points with limits, trim."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import AfterValidator, BeforeValidator, Field, PlainValidator, ValidationInfo

from commonrail.analysis.tolerance.distributions import Distribution, Normal, Triangular, Uniform
from commonrail.analysis.tolerance.tolerances import (
    MOST_FIGURES,
    Correlation,
    Dimension,
    Limit,
    Sampling,
    TolerancePoint,
    Tolerances,
    Trim,
)
from commonrail.arguments import file_path
from commonrail.choices import Precision
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.time_step import DEFAULT_STEP
from commonrail.engine.validity import check_point
from commonrail.errors import ConfigurationError
from commonrail.files.injector_file import load_injector
from commonrail.files.study_models import InItsUnit, known_parameter
from commonrail.injector.definition import Injector, Source, parameter_quantities
from commonrail.reading.faults import read_model
from commonrail.reading.fields import UNSTATED, FileModel, Mark, Text, Unit, choice, fault
from commonrail.reading.place import Place, located
from commonrail.reading.reach import Reach
from commonrail.reading.toml_file import read_toml

__all__ = ["load_tolerances"]

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
