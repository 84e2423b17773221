"""Read features: a measured trace, or values without a trace, and the target of each feature."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import replace
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import AfterValidator, Field, PlainValidator, ValidationInfo

from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError, InputError, nearest
from commonrail.base.units import parse
from commonrail.data.base import Role
from commonrail.data.curves.data import RateData
from commonrail.data.curves.reading import list_pulses
from commonrail.data.curves.samples import RateModel
from commonrail.data.study_block import Context, drive_unit, mass_density
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.status import check_point
from commonrail.physics.injector import Injector
from commonrail.plugins.features.settings import FeatureSettings, Threshold
from commonrail.plugins.features.table import features_of_traces, find_feature
from commonrail.readers.location import Place, locate_errors
from commonrail.readers.toml import FileModel, Unit, fault

RETURNED = "return_quantity"  # of the whole stroke, not of a trace
SAMPLE = 2e-6  # of a simulated trace without a measured one [s]
AFTER = 3e-3  # simulated after the last energising [s]
MOST_TARGETS = 1000

_BY_MASS = {"m3/s": "kg/s", "m3": "kg"}
_SETTINGS = ("threshold", "split", "averaging", "tail", "zero_at_rest")  # that a study states

Number = tuple[float, str]  # value and its SI unit


def _check_feature(item: str) -> str:
    if item not in (names := [*features_of_traces(), RETURNED]):
        raise fault(f'unknown feature "{item}"{nearest(item, names)}')
    return item


def _in_its_unit(item: Any, info: ValidationInfo) -> Number | None:
    """Number in a unit of the feature, whose name was checked before."""
    name = info.data.get("feature")
    if item is None or name is None:
        return None
    unit = find_feature(name).unit
    if by_mass := _BY_MASS.get(unit):
        with suppress(InputError):
            return parse(item, by_mass), by_mass
    return Unit(unit).read(item), unit


_InItsUnit = PlainValidator(_in_its_unit)


class TargetModel(FileModel):
    """Feature of one injection, its tolerance, and its value unless the trace gives it."""

    feature: Annotated[str, AfterValidator(_check_feature)]
    injection: int = Field(default=1, ge=1, le=100)
    tolerance: Annotated[Any, _InItsUnit]
    value: Annotated[Any, _InItsUnit] = None


class FeaturesModel(RateModel):
    """Features of an injection curve, or values without a file."""

    kind: Literal["features"]  # type: ignore[assignment]  # another kind with the keys of a curve
    file: str = ""
    features: list[TargetModel] = Field(min_length=1, max_length=MOST_TARGETS)
    threshold: str | float | None = None
    split: Annotated[float, Unit("1")] | None = None
    averaging: Annotated[float, Unit("s")] | None = None
    tail: Annotated[float, Unit("s")] | None = None
    zero_at_rest: bool | None = None
    stroke_period: Annotated[float, Unit("s")] | None = None


class FeatureTarget(NamedTuple):
    """Feature of one injection, its measured value and its tolerance [SI, by volume].

    `mass_density` is the density [kg/m³] that converted a measured mass to a volume; NaN for other values.
    """

    feature: str
    injection: int
    value: float
    tolerance: float
    mass_density: float = math.nan

    @property
    def text(self) -> str:
        """Name with the number of the injection."""
        return self.feature if self.feature == RETURNED else f"{self.feature} {self.injection}"


def make_settings(model: FeaturesModel, injector: Injector, point: OperatingPoint, at: Place) -> FeatureSettings:
    """Settings of a block; a threshold by mass is converted to one by volume.

    Errors name the place `at` of the block.
    """
    with locate_errors(at):
        stated = {name: value for name in _SETTINGS if (value := getattr(model, name)) is not None}
        settings = FeatureSettings(**stated)
        value, unit = settings.threshold
        if unit == "kg/s":
            return replace(settings, threshold=Threshold(value / mass_density(injector, unit, point), "m3/s"))
        return settings


def read_curve(model: FeaturesModel, context: Context) -> RateData:
    """Read the measured curve of a block; without a file return zeros at the block's operating point.

    `InputError` and `ConfigurationError` as `DataSet.read_all`, also if a file is missing and
    needed.
    """
    if model.file:
        curves = RateData.read_all(model, context)
        if len(curves) != 1:
            raise context.at.error(f"{model.file} holds {len(curves)} curves, and one is expected")
        return curves[0]
    if drive_unit(context.injector):
        raise context.at.error("an injector that is driven by a trace needs a file with the measured drive")
    point = _point(model, context)
    count = math.ceil(point.duration / SAMPLE)
    bounds: Floats = point.start + point.duration * np.arange(count + 1) / count
    labels = model.weight, model.source, model.synthetic
    meter = context.meter(model.meter)
    return RateData(model.name, Role(model.role), point, bounds, np.zeros(count), *labels, meter=meter)


def _point(model: FeaturesModel, context: Context) -> OperatingPoint:
    at = context.at
    pressures = {key: getattr(model, key) for key in ("rail_pressure", "cylinder_pressure", "return_pressure")}
    for key, value in pressures.items():
        if not isinstance(value, float):
            raise (at / key).error("without a file this must be one pressure")
    pulses = list_pulses(model, at)
    with locate_errors(at):
        start = min(0.0, pulses[0].start)
        last = max(pulse.start + pulse.duration for pulse in pulses)
        steps = math.ceil((last + AFTER - start) / context.time_step - 1e-6)
        rail, cylinder, low = pressures.values()
        point = OperatingPoint(rail, pulses, cylinder, low, horizon=steps * context.time_step, start=start)
        check_point(context.injector, point)
        return point


def read_targets(
    model: FeaturesModel, injector: Injector, point: OperatingPoint, measured: Any, at: Place
) -> tuple[FeatureTarget, ...]:
    """Read the targets of a block; the measured trace gives missing values.

    The fuel of the `injector` converts masses to volumes. `InputError` and `ConfigurationError` if a value is
    missing there too, an injection has no energising, or a target is repeated.
    """
    targets = []
    for i, item in enumerate(model.features):
        place = (at / "features")[i]
        if item.injection > len(point.pulses):
            raise (place / "injection").error(f"there is no energising {item.injection}; there are {len(point.pulses)}")
        tolerance = _by_volume(item.tolerance, injector, point)
        if not tolerance > 0.0:
            raise (place / "tolerance").error("the tolerance must be greater than zero")
        if item.value is None:
            value, density = _read_measured_value(item, measured, place), math.nan
        else:
            value = _by_volume(item.value, injector, point)
            density = mass_density(injector, item.value[1], point)
        targets.append(FeatureTarget(item.feature, item.injection, value, tolerance, density))
    names = [target.text for target in targets]
    for name in names:
        if names.count(name) > 1:
            raise ConfigurationError(f"{at / 'features'}: {name} is stated more than once; keep one of them.")
    return tuple(targets)


def _by_volume(number: Number, injector: Injector, point: OperatingPoint) -> float:
    value, unit = number
    return value / mass_density(injector, unit, point) if unit.startswith("kg") else value


def _read_measured_value(item: TargetModel, measured: Any, place: Place) -> float:
    if item.feature == RETURNED or measured is None:
        raise (place / "value").error("no trace gives this feature; state its value")
    value = measured.value(item.feature, item.injection)
    if not math.isfinite(value):
        raise place.error(
            f"the measured trace has no {item.feature} of injection {item.injection}: "
            + measured.reason(item.injection).sentence.removesuffix(".")
        )
    return float(value)
