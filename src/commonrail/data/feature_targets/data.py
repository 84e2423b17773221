"""Features of injections as a kind of measured data: each judged against its tolerance."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self

import numpy as np

from commonrail.base.arguments import instance, instances, settle
from commonrail.base.arrays import Bools, Floats
from commonrail.base.errors import ConfigurationError
from commonrail.base.text import number
from commonrail.data.base import DataSet, Missing, Role, Term, share_of
from commonrail.data.curves.data import RateData
from commonrail.data.feature_targets.page import FeatureView
from commonrail.data.feature_targets.reading import (
    AFTER,
    RETURNED,
    FeaturesModel,
    FeatureTarget,
    read_curve_of,
    read_targets,
    settings_of,
)
from commonrail.data.features.features import features
from commonrail.data.features.rate_trace import RateTrace, rate_trace
from commonrail.data.features.result import Features
from commonrail.data.features.settings import FeatureSettings, Levels
from commonrail.data.features.table import find_feature
from commonrail.data.noise import NOISE, Noise
from commonrail.data.quantities.data import soft_l1
from commonrail.data.quantities.returned import ReturnData
from commonrail.data.records import MEASURED, point_record
from commonrail.data.simulator import ITSELF, Candidates, Simulator
from commonrail.data.study_block import Context
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.solution import Batch
from commonrail.engine.status import which_failed
from commonrail.physics.meters.meter import Meter

NO_FEATURE = "NO_FEATURE"


@dataclass(frozen=True)
class FeatureScore:
    """Simulated features [SI], NaN where there is none, root mean square error in tolerances, and reasons.

    A reason says why a trace lacks a feature; it is empty where there is a number, and where the simulation failed.
    """

    values: Floats
    error: float
    reasons: tuple[str, ...]


@dataclass(frozen=True)
class FeatureData(DataSet):
    """Measured features of the injections at one operating point.

    Attributes
    ----------
    name : str
    role : Role
    curve : RateData
        Measured trace that gives samples, window, operating point and density; zero where only values were measured.
    targets : tuple of FeatureTarget
    settings : FeatureSettings
        Of measured and simulated features alike.
    levels : Levels or None
        Of the measured trace, applied to the simulated ones; None: each simulated trace has its own.
    weight : float
    source, synthetic : str
    stroke_period : float or None
        Of a return quantity, as in `ReturnData`.
    meter : Meter or None
        The simulated rate is looked at as this meter shows it.
    noise : Noise
        Its standard deviations are multiples of the tolerance.
    points : tuple of OperatingPoint
        The one point, for each target.

    Raises
    ------
    ConfigurationError
        If an argument is of another kind, or there is no target.
    """

    kind: ClassVar[str] = "features"
    what: ClassVar[str] = "feature"
    unit: ClassVar[str] = "1"
    error_head: ClassVar[tuple[str, str]] = ("rms", "tolerances")
    model: ClassVar[type[FeaturesModel]] = FeaturesModel
    view: ClassVar[FeatureView] = FeatureView()
    seen: ClassVar[frozenset[str]] = RateData.seen

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
    points: tuple[OperatingPoint, ...] = field(init=False, repr=False, compare=False)
    returned: ReturnData | None = field(init=False, repr=False, compare=False)
    simulated_points: tuple[OperatingPoint, ...] = field(init=False, repr=False, compare=False)

    bounds = None

    def __post_init__(self) -> None:
        curve = instance(self.curve, RateData, "curve of the features").with_meter(self.meter)
        settle(self, curve=curve, mass_density=curve.mass_density)
        self._settle_labels()
        targets = instances(self.targets, FeatureTarget, "targets of the features")
        if not targets:
            raise ConfigurationError(f"{self.name} has no feature; name at least one.")
        returned = self._returns([target for target in targets if target.feature == RETURNED])
        settle(
            self,
            targets=targets,
            points=(curve.point,) * len(targets),
            returned=returned,
            simulated_points=curve.points if returned is None else curve.points + returned.points,
        )

    def _returns(self, targets: Sequence[FeatureTarget]) -> ReturnData | None:
        """The return quantity as a map of one point, which is simulated beyond the end of injection."""
        if not targets:
            return None
        point = self.curve.point
        end = max(pulse.start + pulse.duration for pulse in point.pulses) + AFTER
        longer = replace(point, horizon=max(end - point.start, point.duration))
        value, tolerance = np.array([targets[0].value]), targets[0].tolerance
        none = np.zeros(1, bool)
        more = self.weight, self.source, self.synthetic, targets[0].mass_density
        return ReturnData(
            self.name, self.role, (longer,), value, tolerance, 0.0, none, *more, stroke_period=self.stroke_period
        )

    @classmethod
    def read(cls, model: FeaturesModel, context: Context) -> Self:
        """Read features; see `DataSet.read`."""
        curve = read_curve_of(model, context)
        settings = settings_of(model, context.injector, curve.point, context.at)
        measured = features(curve, settings=settings) if model.file else None
        targets = read_targets(model, context.injector, curve.point, measured, context.at)
        levels = None if measured is None else measured.levels
        labels = model.weight, model.source, model.synthetic
        more = model.stroke_period, context.meter(model.meter)
        return cls(model.name, Role(model.role), curve, targets, settings, levels, *labels, *more)

    @property
    def injections(self) -> int:
        """One injection, and one more for a return quantity."""
        return len(self.simulated_points)

    @classmethod
    def terms(cls, group: Sequence[Self], time_step: float) -> list[Term]:
        """One term for each data set; the features are found in traces outside of its batch."""
        return [
            Term(d.simulated_points, np.array([d.weight]), d._j_of, d._squares_of, which_failed, whole=d.whole)
            for d in group
        ]

    @property
    def whole(self) -> bool:
        """True if there is a return quantity, see `Term.whole`."""
        return self.returned is not None

    @property
    def measured(self) -> Floats:
        """Measured features [SI]."""
        return np.array([target.value for target in self.targets])

    @property
    def tolerances(self) -> Floats:
        """Tolerances of the features [SI]."""
        return np.array([target.tolerance for target in self.targets])

    @property
    def judged(self) -> Bools:
        """Rates and quantities, which a gain multiplies; times are not."""
        return np.array([find_feature(target.feature).unit in ("m3", "m3/s") for target in self.targets])

    @property
    def samples(self) -> int:
        """Samples of the trace, and features."""
        return self.curve.samples + len(self.targets)

    def simulated(self, simulator: Simulator, values: Floats) -> Floats:
        """Features (candidates, targets) [SI] of simulated traces, as the meter shows them if there is one."""
        rates = self.curve.simulated(simulator, values)
        trace = rate_trace(self.curve)
        found = np.array([self._values_of(self._found(trace, rate)) for rate in rates])
        if self.returned is not None:
            column = [target.feature for target in self.targets].index(RETURNED)
            found[:, column] = self.returned.simulated(simulator, values)[:, 0]
            found[np.isnan(rates).any(axis=1)] = np.nan
        return found * self._by_mass(Candidates(simulator, values))

    def _by_mass(self, candidates: Candidates) -> Floats:
        """Factors (candidates or 1, targets) on volumes whose measured values were made of masses.

        A mass is compared with a mass, whatever the density of the candidate or of its meter.
        """
        stated = np.array([target.mass_density for target in self.targets])
        by_mass = np.isfinite(stated) & np.array([target.feature != RETURNED for target in self.targets])
        if not by_mass.any():
            return np.ones((1, len(self.targets)))
        given = candidates.given(self.meter) if self.meter is not None else None
        density = np.reshape(self.curve.density_of(candidates, given), (-1, 1))
        return np.where(by_mass, density / stated, 1.0)

    def _found(self, trace: RateTrace, rate: Floats) -> Features | None:
        """Features of a simulated rate, by the function and the levels of the measured ones; None of a failed one."""
        if not np.isfinite(rate).all():
            return None
        return features(trace.with_rate(rate), settings=self.settings, levels=self.levels)

    def _values_of(self, found: Features | None) -> list[float]:
        if found is None:
            return [math.nan] * len(self.targets)
        return [
            math.nan if target.feature == RETURNED else found.value(target.feature, target.injection)
            for target in self.targets
        ]

    def errors(self, values: Floats) -> Floats:
        """(Feature − measured)/tolerance of simulated features (…, targets)."""
        return np.asarray((values - self.measured) / self.tolerances)

    def misfit(self, values: Floats) -> Floats:
        """J of simulated features: the soft-L1 sum of `errors`."""
        return soft_l1(self.errors(values))

    def residuals(self, values: Floats) -> Floats:
        """`errors`, scaled by the root of the weight."""
        return np.asarray(np.sqrt(self.weight) * self.errors(values))

    def discrepancy(self, values: Floats) -> Floats:
        """Tolerances of predicted features."""
        return np.broadcast_to(self.tolerances, values.shape)

    def score(self, simulator: Simulator) -> FeatureScore:
        """Score of the simulator's injector as it is, with the reason of each missing feature."""
        rate = self.curve.simulated(simulator, ITSELF)[0]
        values = self.simulated(simulator, ITSELF)[0]
        found = self._found(rate_trace(self.curve), rate)
        reasons = tuple(
            "" if found is None or math.isfinite(value) else found.reason(target.injection).sentence
            for value, target in zip(values.tolist(), self.targets, strict=True)
        )
        return FeatureScore(values, float(np.sqrt(np.mean(self.errors(values) ** 2))), reasons)

    def missing(self, score: FeatureScore) -> list[Missing]:
        """Features without a number: of a failed simulation, or of a trace that does not have them."""
        return [
            Missing(point, NO_FEATURE, f"{target.text}: {reason}") if reason else Missing(point)
            for point, target, value, reason in zip(
                self.points, self.targets, score.values.tolist(), score.reasons, strict=True
            )
            if not math.isfinite(value)
        ]

    def quantities(self, score: FeatureScore) -> tuple[Floats, Floats]:
        """Measured and simulated quantities of injections where there are both [m³]."""
        both = np.isfinite(score.values) & np.array(
            [target.feature in ("quantity", "total_quantity") for target in self.targets]
        )
        return self.measured[both], score.values[both]

    def relative_error(self, score: FeatureScore) -> float:
        """Σ |error| over Σ |feature|, each in its tolerances; NaN for a failed simulation."""
        return share_of(
            np.sum(np.abs(self.errors(score.values))), float(np.sum(np.abs(self.measured / self.tolerances)))
        )

    def best_gain(self, score: FeatureScore, gains: Floats) -> float:
        """Factor on the simulated rates and quantities that makes J least; 1 where there are times alone."""
        return super().best_gain(score, gains) if self.judged.any() else 1.0

    def record(self, scores: Mapping[str, FeatureScore]) -> dict[str, Any]:
        """A row for each feature, and root mean squares in tolerances, by label."""
        rows = [
            {
                "feature": target.feature,
                "injection": target.injection,
                "unit": find_feature(target.feature).unit,
                "meaning": find_feature(target.feature).meaning,
                "tolerance": target.tolerance,
                MEASURED: target.value,
                **{label: number(float(score.values[i])) for label, score in scores.items()},
            }
            for i, target in enumerate(self.targets)
        ]
        return {
            **point_record(self.curve.point),
            "rows": rows,
            "rms": {label: number(score.error) for label, score in scores.items()},
        }

    def _j_of(self, batch: Batch, candidates: Candidates) -> Floats:
        return self.misfit(self.simulated(*candidates))[:, None]

    def _squares_of(self, batch: Batch, candidates: Candidates) -> Floats:
        return np.asarray(np.sum(self.errors(self.simulated(*candidates)) ** 2, axis=1)[:, None])
