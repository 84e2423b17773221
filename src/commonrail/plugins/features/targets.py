"""Features of injections as measured data, each judged against its tolerance."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Annotated, Any, ClassVar, NamedTuple, Self

import numpy as np

from commonrail.base.arguments import instance, instances, settle
from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError
from commonrail.base.record import Key, to_record
from commonrail.base.text import number
from commonrail.data.base import Missing, Role, Score, Term, ToleratedData, make_term, read_labels, relative_to
from commonrail.data.curves.data import RateData
from commonrail.data.noise import NOISE, Noise
from commonrail.data.quantities.returned import ReturnData
from commonrail.data.records import point_record
from commonrail.data.simulator import ITSELF, Candidates, Simulator
from commonrail.data.study_block import Context
from commonrail.engine.solution import Batch
from commonrail.engine.status import which_failed
from commonrail.physics.meters import Meter
from commonrail.plugins.features import targets_file
from commonrail.plugins.features.levels import Levels
from commonrail.plugins.features.rate_trace import RateTrace, rate_trace
from commonrail.plugins.features.result import Features
from commonrail.plugins.features.run import find_features
from commonrail.plugins.features.settings import FeatureSettings
from commonrail.plugins.features.table import find_feature
from commonrail.plugins.features.targets_file import RETURNED, FeaturesModel, FeatureTarget

NO_FEATURE = "NO_FEATURE"


class FeatureRow(NamedTuple):
    """Feature of an injection [SI]: measured, with its tolerance, and of models by label.

    Read from a record, `models` is the whole row.
    """

    feature: str
    injection: int
    unit: str
    meaning: str
    tolerance: float
    measured: float
    models: Annotated[Mapping[str, Any], Key("")]

    @property
    def name(self) -> str:
        """Name with the number of the injection; a return is of the whole stroke."""
        return self.feature if self.feature == RETURNED else f"{self.feature} {self.injection}"

    def error(self, label: str) -> float | None:
        """Error of a model in tolerances."""
        value = number(self.models.get(label))
        return None if value is None else (value - self.measured) / self.tolerance


@dataclass(frozen=True, eq=False)
class FeatureData(ToleratedData):
    """Measured features of the injections at one operating point.

    Attributes
    ----------
    name : str
    role : Role
    curve : RateData
        Measured trace with samples, window, operating point and density; zero if only values were measured.
    targets : tuple of FeatureTarget
    settings : FeatureSettings
        For measured and simulated features.
    levels : Levels or None
        From the measured trace, applied to simulated ones; None: each simulated trace has its own.
    weight : float
    source, synthetic : str
    stroke_period : float or None
        Of a return quantity, as in `ReturnData`.
    meter : Meter or None
        Applied to the simulated rate.
    noise : Noise
        Its standard deviations are multiples of the tolerance.
    points : tuple of OperatingPoint
        The operating point, repeated for each target.
    judged : (targets,) bool
        True for rates and quantities, which a gain multiplies; false for times.

    Raises
    ------
    ConfigurationError
        If an argument is of the wrong type, or there are no targets.
    """

    kind: ClassVar[str] = "features"
    what: ClassVar[str] = "feature"
    unit: ClassVar[str] = "1"
    error_head: ClassVar[tuple[str, str]] = ("rms", "tolerances")
    model: ClassVar[type[FeaturesModel]] = FeaturesModel
    meter_inputs: ClassVar[frozenset[str]] = RateData.meter_inputs

    name: str
    role: Role
    curve: RateData
    targets: tuple[FeatureTarget, ...]
    settings: FeatureSettings
    levels: Levels | None
    weight: float
    source: str
    synthetic: str
    stroke_period: float | None = None
    meter: Meter | None = None
    noise: Noise = NOISE
    mass_density: float = field(init=False, repr=False, compare=False)
    returned: ReturnData | None = field(init=False, repr=False, compare=False)

    bounds = None

    def __post_init__(self) -> None:
        curve = instance(self.curve, RateData, "curve of the features").changed(meter=self.meter)
        settle(self, curve=curve, mass_density=curve.mass_density)
        read_labels(self)
        targets = instances(self.targets, FeatureTarget, "targets of the features")
        if not targets:
            raise ConfigurationError(f"{self.name} has no feature; name at least one.")
        returned = _make_return_data(self, [target for target in targets if target.feature == RETURNED])
        settle(
            self,
            targets=targets,
            points=(curve.point,) * len(targets),
            returned=returned,
            has_return=returned is not None,
            simulated_points=curve.points if returned is None else curve.points + returned.points,
            measured=np.array([target.value for target in targets]),
            tolerances=np.array([target.tolerance for target in targets]),
            judged=np.array([find_feature(target.feature).unit in ("m3", "m3/s") for target in targets]),
        )

    @classmethod
    def read_all(cls, model: FeaturesModel, context: Context) -> tuple[Self, ...]:
        """Read features; see `DataSet.read_all`."""
        curve = targets_file.read_curve(model, context)
        settings = targets_file.make_settings(model, context.injector, curve.point, context.at)
        measured = find_features(curve, settings=settings) if model.file else None
        targets = targets_file.read_targets(model, context.injector, curve.point, measured, context.at)
        levels = None if measured is None else measured.levels
        labels = model.weight, model.source, model.synthetic
        more = model.stroke_period, context.meter(model.meter)
        return (cls(model.name, Role(model.role), curve, targets, settings, levels, *labels, *more),)

    @classmethod
    def terms(cls, group: Sequence[Self], time_step: float) -> list[Term]:
        """One term per data set, which simulates its own traces to find the features in them."""
        return [make_term(d, partial(_in_term, d), which_failed, to_horizon=d.returned is not None) for d in group]

    @property
    def samples(self) -> int:
        """Number of samples of the trace and of features."""
        return self.curve.samples + len(self.targets)

    def simulated(self, simulator: Simulator, values: Floats) -> Floats:
        """Features (candidates, targets) [SI] of simulated traces, after the meter if there is one."""
        rates = self.curve.simulated(simulator, values)
        trace = rate_trace(self.curve)
        values_by_target = np.array([self._find_values(trace, rate) for rate in rates])
        if self.returned is not None:
            column = [target.feature for target in self.targets].index(RETURNED)
            values_by_target[:, column] = self.returned.simulated(simulator, values)[:, 0]
            values_by_target[np.isnan(rates).any(axis=1)] = np.nan
        return values_by_target * self._by_mass(Candidates(simulator, values))

    def _by_mass(self, candidates: Candidates) -> Floats:
        """Factors (candidates or 1, targets) on volumes whose measured values were converted from masses.

        A mass is compared with a mass, whatever the density of the candidate or of its meter.
        """
        stated = np.array([target.mass_density for target in self.targets])
        by_mass = np.isfinite(stated) & np.array([target.feature != RETURNED for target in self.targets])
        if not by_mass.any():
            return np.ones((1, len(self.targets)))
        meter_values = candidates.meter_values(self.meter) if self.meter is not None else None
        density = np.reshape(self.curve.density_of(candidates, meter_values), (-1, 1))
        return np.where(by_mass, density / stated, 1.0)

    def _find_features(self, trace: RateTrace, rate: Floats) -> Features | None:
        """Features of a simulated rate by the measured levels; None if the simulation failed."""
        if not np.isfinite(rate).all():
            return None
        return find_features(trace.with_rate(rate), settings=self.settings, levels=self.levels)

    def _find_values(self, trace: RateTrace, rate: Floats) -> list[float]:
        features = self._find_features(trace, rate)
        return [
            math.nan
            if features is None or target.feature == RETURNED
            else features.value(target.feature, target.injection)
            for target in self.targets
        ]

    def discrepancy(self, values: Floats) -> Floats:
        """Tolerances of predicted features."""
        return np.broadcast_to(self.tolerances, values.shape)

    def score(self, simulator: Simulator) -> FeatureScore:
        """Score of the simulator's injector without changes, with the reason of each missing feature."""
        rate = self.curve.simulated(simulator, ITSELF)[0]
        values = self.simulated(simulator, ITSELF)[0]
        features = self._find_features(rate_trace(self.curve), rate)
        reasons = tuple(
            "" if features is None or math.isfinite(value) else features.reason(target.injection).sentence
            for value, target in zip(values.tolist(), self.targets, strict=True)
        )
        return FeatureScore(self, values, reasons)

    def record(self, scores: Mapping[str, FeatureScore]) -> dict[str, Any]:
        """One row per feature, and root mean squares in tolerances, by label."""
        rows = tuple(
            FeatureRow(
                feature=target.feature,
                injection=target.injection,
                unit=find_feature(target.feature).unit,
                meaning=find_feature(target.feature).meaning,
                tolerance=target.tolerance,
                measured=target.value,
                models={label: float(score.values[i]) for label, score in scores.items()},
            )
            for i, target in enumerate(self.targets)
        )
        rms = {label: score.error for label, score in scores.items()}
        return {**point_record(self.curve.point), **to_record({"rows": rows, "rms": rms})}


@dataclass(frozen=True)
class FeatureScore(Score):
    """Simulated features [SI], NaN if missing, and reasons.

    A reason states why a trace lacks a feature; it is empty for a number and for a failed simulation.
    """

    data: FeatureData
    reasons: tuple[str, ...]

    @property
    def error(self) -> float:
        """Root mean square error in tolerances."""
        return float(np.sqrt(np.mean(self.data.errors(self.values) ** 2)))

    def missing(self) -> list[Missing]:
        """Features without a number: of a failed simulation, or of a trace without them."""
        rows = zip(self.data.points, self.data.targets, self.values.tolist(), self.reasons, strict=True)
        return [
            Missing(point, NO_FEATURE, f"{target.text}: {reason}") if reason else Missing(point)
            for point, target, value, reason in rows
            if not math.isfinite(value)
        ]

    def quantities(self) -> tuple[Floats, Floats]:
        """Measured and simulated quantities of injections that have both [m³]."""
        both = np.isfinite(self.values) & np.array(
            [target.feature in ("quantity", "total_quantity") for target in self.data.targets]
        )
        return self.data.measured[both], self.values[both]

    def relative_error(self) -> float:
        """Σ |error| over Σ |feature|, each in its tolerances; NaN for a failed simulation."""
        data = self.data
        level = float(np.sum(np.abs(data.measured / data.tolerances)))
        return relative_to(np.sum(np.abs(data.errors(self.values))), level)

    def best_gain(self, gains: Floats) -> float:
        """Factor on the simulated rates and quantities that minimises J; 1 if there are only times."""
        return super().best_gain(gains) if self.data.judged.any() else 1.0


def _in_term(data: FeatureData, batch: Batch, candidates: Candidates) -> Floats:
    return data.simulated(*candidates)


def _make_return_data(data: FeatureData, targets: Sequence[FeatureTarget]) -> ReturnData | None:
    """Return quantity as a map of one point, which is simulated beyond the end of injection."""
    if not targets:
        return None
    point = data.curve.point
    end = max(pulse.start + pulse.duration for pulse in point.pulses) + targets_file.AFTER
    longer = replace(point, horizon=max(end - point.start, point.duration))
    value, tolerance = np.array([targets[0].value]), targets[0].tolerance
    none = np.zeros(1, bool)
    more = data.weight, data.source, data.synthetic, targets[0].mass_density
    return ReturnData(
        data.name, data.role, (longer,), value, tolerance, 0.0, none, *more, stroke_period=data.stroke_period
    )
