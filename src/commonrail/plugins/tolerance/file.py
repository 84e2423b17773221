"""Files of a tolerance study: record and table of its result, and the TOML file that it is read from."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import AfterValidator, Field, PlainValidator, ValidationInfo

from commonrail.base.arguments import file_path
from commonrail.base.choices import Precision
from commonrail.base.display import Shown
from commonrail.base.errors import ConfigurationError
from commonrail.calibration.study_file import named_injector
from commonrail.calibration.study_keys import InItsUnit, known_parameter
from commonrail.data.records import record_head
from commonrail.engine.operating_point import OperatingPoint
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
from commonrail.readers.location import located
from commonrail.readers.toml import UNSTATED, FileModel, Mark, Sourced, Text, Unit, choice, fault, read_model_file


class PointResult(NamedTuple):
    """Quantity as drawn [m³], spread, and shares of the variance (None where nothing scatters) at one point."""

    name: str
    point: OperatingPoint
    nominal: float
    spread: Spread
    shares: Shares | None


@dataclass(frozen=True, repr=False)
class ToleranceResult(Shown):
    """Result of a tolerance study.

    Attributes
    ----------
    tolerances : Tolerances
    points : tuple of PointResult
    trim : Trimmed or None
    status : str
        "complete", or "interrupted" with the parts that were simulated.
    confidence : float
        Probability of the intervals.
    parts : int
        Number of parts simulated.
    injections : int
        Single simulations that it took.
    seconds : float
    """

    presenter = "commonrail.plugins.tolerance.page:TOLERANCE"

    tolerances: Tolerances
    points: tuple[PointResult, ...]
    trim: Trimmed | None
    status: str
    confidence: float
    parts: int
    injections: int
    seconds: float

    @property
    def synthetic(self) -> str:
        """Assumed parts of injector and tolerances; empty if nothing is assumed."""
        texts = (self.tolerances.synthetic, self.tolerances.injector.synthetic)
        return " ".join(dict.fromkeys(text for text in texts if text))

    def rows(self) -> list[dict[str, Any]]:
        """One flat row for each operating point and dimension, SI; ``pandas.DataFrame(rows)`` takes them."""
        flat = []
        for found in self.record()["points"]:
            spread = found["spread"]
            head = {"point": found["name"], "nominal": found["nominal"], "mean": spread["mean"]}
            head |= {"deviation": spread["deviation"], "out": spread["out"]["value"]}
            for row in found["dimensions"]:
                share = row["share"] or {"value": None, "low": None, "high": None}
                ends = {"share": share["value"], "share_low": share["low"], "share_high": share["high"]}
                flat.append(
                    {**head, "dimension": row["name"], **ends, "swing": row["swing"], "if_halved": row["if_halved"]}
                )
        return flat

    def record(self) -> dict[str, Any]:
        """JSON-able form, SI; what does not exist is None."""
        t = self.tolerances
        return {
            **record_head("tolerance", t.title, self.synthetic),
            "injector": {"name": t.injector.name, "title": t.injector.title, "variant": t.injector.variant.label},
            "status": self.status,
            "asked": t.parts,
            "parts": self.parts,
            "injections": self.injections,
            "seed": t.seed,
            "sampling": t.sampling.value,
            "time_step": t.time_step,
            "precision": t.precision.value,
            "confidence": self.confidence,
            "dimensions": [_dimension(t, j) for j in range(len(t.dimensions))],
            "correlations": [c._asdict() for c in t.correlations],
            "points": [self._point(p) for p in self.points],
            "trim": self._trim(),
            "clock": {"seconds": self.seconds},
        }

    def _point(self, found: PointResult) -> dict[str, Any]:
        rows = [_shared(found, j, name) for j, name in enumerate(self.tolerances.names)]
        if found.shares is not None:
            rows = [rows[int(j)] for j in np.argsort(-found.shares.value, kind="stable")]
        pulses = [{"start": p.start, "duration": p.duration} for p in found.point.pulses]
        return {
            "name": found.name,
            "rail_pressure": found.point.at_start(found.point.rail_pressure),
            "energisings": pulses,
            "nominal": found.nominal,
            "spread": found.spread.record(),
            "dimensions": rows,
            "rest": None if found.shares is None else found.shares.rest,
        }

    def _trim(self) -> dict[str, Any] | None:
        trim, given = self.trim, self.tolerances.trim
        if trim is None or given is None:
            return None
        return {
            "test_points": list(given.points),
            "parts": trim.parts,
            "unmeasured": trim.unmeasured,
            "resolution": given.resolution,
            "scatter": given.scatter,
            "slopes": list(trim.slopes),
            "points": [point.record() for point in trim.points],
        }


def _dimension(t: Tolerances, j: int) -> dict[str, Any]:
    dimension = t.dimensions[j]
    quantity = parameter_quantities()[dimension.name]
    return {
        "name": dimension.name,
        "unit": quantity.unit,
        "drawn": t.injector.values[dimension.name],
        "distribution": dimension.distribution.record(),
        "mark": dimension.source.mark,
        "source": dimension.source.text,
    }


def _shared(found: PointResult, j: int, name: str) -> dict[str, Any]:
    """Share of a dimension, and the standard deviation if its own were halved and all else stayed."""
    shares = found.shares
    if shares is None:
        return {"name": name, "share": None, "swing": None, "if_halved": None}
    share = {key: float(getattr(shares, key)[j]) for key in ("value", "low", "high")}
    return {"name": name, "share": share, "swing": float(shares.swing[j]), "if_halved": float(shares.halved[j])}


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
    """Share that is given in percent, or number in an SI unit; and which of them it is."""
    relative = isinstance(item, str) and "%" in item
    return Unit("1" if relative else unit).read(item), relative


def _width(item: Any, info: ValidationInfo) -> _Width:
    """Width in percent of the drawing's value, or in the unit of the parameter; any where the name is refused."""
    name = info.data.get("name")
    return _Width(*_read(item, parameter_quantities()[name].unit)) if name else _Width(0.0, False)


def _limit(item: Any) -> Limit:
    """Limit as a quantity, or as its deviation from the nominal one in percent."""
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
    model, at, reach, text = read_model_file(_ToleranceModel, file)
    injector = named_injector(model.injector, file.parent, reach, at / "injector")
    dimensions = []
    for i, item in enumerate(model.dimension):
        with located((at / "dimension")[i]):
            distribution = _distribution(item, injector.values[item.name])
            dimensions.append(Dimension(item.name, distribution, item.origin(Source(model.mark, model.source))))
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
            None if model.trim is None else SeriesTrim(**(dict(model.trim) | {"points": tuple(model.trim.points)})),
            parts=model.parts,
            seed=model.seed,
            sampling=model.sampling,
            time_step=model.time_step,
            precision=model.precision,
            synthetic=model.synthetic,
            text=text,
        )


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
