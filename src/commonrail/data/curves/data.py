"""Injection curve as a kind of measured data: rate of injection against time; its J is the paper's."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar, Self

import numpy as np

from commonrail.base.arguments import array, instance, settle
from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError
from commonrail.base.text import number
from commonrail.data.base import (
    DataSet,
    Missing,
    Role,
    Score,
    Term,
    is_metered,
    make_term,
    read_labels,
    relative_to,
    value_widths,
)
from commonrail.data.curves.reading import read_curves
from commonrail.data.curves.samples import RateModel
from commonrail.data.noise import NOISE, Noise
from commonrail.data.records import MEASURED, MM3_PER_MS, point_record
from commonrail.data.simulator import ITSELF, Candidates, Simulator
from commonrail.data.study_block import Context, mass_density
from commonrail.engine.lanes import Misfit
from commonrail.engine.operating_point import OperatingPoint, Trace
from commonrail.engine.simulate import sampled_rates
from commonrail.engine.solution import Batch
from commonrail.engine.status import which_failed
from commonrail.physics.meters import QUANTITIES, Meter, QuantityValues, shown_rates
from commonrail.readers.location import locate_errors

LARGEST_RATE = 0.1  # [m³/s] a thousand times the rate of a large truck's injector


@dataclass(frozen=True, eq=False)
class RateData(DataSet):
    """A measured injection curve (EVI) at one operating point.

    Attributes
    ----------
    name : str
    role : Role
    point : OperatingPoint
        Its horizon ends at or after the last bound.
    bounds : (samples + 1,)
        Bounds of the samples that count [s]; a sample is the mean flow between two bounds.
    rate : (samples,)
        Measured rate of injection by volume [m³/s].
    weight : float
        Factor of its J in the objective.
    source, synthetic : str
        Where the data come from; what about them is synthetic, empty if measured.
    mass_density : float
        Density [kg/m³] that made a volume of a rate measured by mass, and makes one of the simulated rate: masses are
        compared with masses. NaN for a rate measured by volume, which is compared at each candidate's own density.
    meter : Meter or None
        Of the bench: the simulated rate is compared as this meter shows it.
    noise : Noise
        Its standard deviations are rates [m³/s].

    Raises
    ------
    ConfigurationError
        If an argument is of another kind, the bounds do not increase, or there is not one rate between each two.
    """

    kind: ClassVar[str] = "rate"
    what: ClassVar[str] = "rate"
    unit: ClassVar[str] = "m3/s"
    error_head: ClassVar[tuple[str, str]] = ("J", "mm3/ms")
    model: ClassVar[type[RateModel]] = RateModel
    meter_inputs: ClassVar[frozenset[str]] = frozenset(QUANTITIES) - {"quantity_offset"}
    sigma_unit: ClassVar[str] = "m3/s"
    residual_unit: ClassVar[str] = "mm3/ms"
    residual_scale: ClassVar[float] = MM3_PER_MS

    name: str
    role: Role
    point: OperatingPoint
    bounds: Floats
    rate: Floats
    weight: float
    source: str
    synthetic: str
    mass_density: float = math.nan
    meter: Meter | None = None
    noise: Noise = NOISE

    def __post_init__(self) -> None:
        read_labels(self)
        instance(self.point, OperatingPoint, "point of the data")
        bounds, rate = array(self.bounds, "s", "bounds of the data", 1), array(self.rate, "m3/s", "rate of the data", 1)
        if len(bounds) != len(rate) + 1 or not len(rate):
            raise ConfigurationError(
                f"The bounds of {self.name} must be one more than its rates, and {len(bounds)} bounds and {len(rate)} "
                "rates were given."
            )
        if not np.all(np.diff(bounds) > 0.0):
            raise ConfigurationError(f"The bounds of {self.name} must increase from sample to sample.")
        if (peak := float(np.abs(rate).max())) > LARGEST_RATE:
            raise ConfigurationError(
                f"The rate of {self.name} reaches {peak * MM3_PER_MS:.3g} mm3/ms, and no injector has more than "
                f"{LARGEST_RATE * MM3_PER_MS:.3g}; correct its unit."
            )
        points = (self.point,)
        settle(self, bounds=bounds, rate=rate, measured=rate, judged=np.ones(len(rate), bool))
        settle(self, points=points, simulated_points=points)

    @classmethod
    def read_all(cls, model: RateModel, context: Context) -> tuple[Self, ...]:
        """Read the injection curves of a block; see `DataSet.read_all`."""
        curves = []
        for curve, point in read_curves(model, context):
            samples = curve.samples
            density = mass_density(context.injector, samples.unit, point)
            scale = 1.0 if math.isnan(density) else density
            name = f"{model.name}, {curve.label}" if curve.label else model.name
            source = f"{model.source}; mean of {curve.shots} shots" if curve.shots > 1 else model.source
            read = point, samples.bounds, samples.rate / scale, model.weight, source, model.synthetic, density
            with locate_errors(context.at):
                curves.append(cls(name, Role(model.role), *read, context.meter(model.meter), curve.noise(scale)))
        return tuple(curves)

    @classmethod
    def terms(cls, group: Sequence[Self], time_step: float) -> list[Term]:
        """One term: all curves are simulated in one batch, which adds up their errors itself.

        With a meter among them, a term for each curve; the errors of one with a meter are added up outside.
        """
        if all(d.meter is None for d in group):
            weights, samples = np.array([d.weight for d in group]), _samples(group, time_step)
            return [Term([d.point for d in group], weights, _sum_errors, _sum_squares, which_failed, samples)]
        return [
            cls.terms([d], time_step)[0] if d.meter is None else make_term(d, partial(_in_term, d), which_failed)
            for d in group
        ]

    @property
    def samples(self) -> int:
        """Samples of the curve and of the courses that belong to its operating point."""
        p = self.point
        courses = (p.rail_pressure, p.cylinder_pressure, p.return_pressure, p.drive)
        return len(self.rate) + sum(len(course.time) for course in courses if isinstance(course, Trace))

    def simulated(self, simulator: Simulator, values: Floats) -> Floats:
        """Simulated samples (candidates, samples) [m³/s], as the meter shows them if there is one."""
        candidates = Candidates(simulator, values)
        if is_metered(self, simulator):
            return self._as_metered(candidates)
        s = simulator
        inputs = s.injector, self.point, self.bounds, *s.of_injector(values), s.time_step
        rates = sampled_rates(*inputs, threads=s.threads, prepared=s.prepared(self.points), same_bits=s.same_bits)
        return rates / self.density_of(candidates)

    def _as_metered(self, candidates: Candidates) -> Floats:
        """Samples (candidates, samples) [m³/s] as the meter shows them."""
        assert self.meter is not None
        meter_values = candidates.meter_values(self.meter)
        mass = candidates.simulator.flow(self.point, candidates.values, self.meter.ahead)
        flow = mass._replace(rates=mass.rates / self.density_of(candidates, meter_values))
        return shown_rates(self.meter, meter_values, flow, self.bounds)

    def density_of(self, candidates: Candidates, meter_values: QuantityValues | None = None) -> Floats | float:
        """Density [kg/m³] that makes volumes of the simulated masses."""
        return candidates.densities(self.points, meter_values) if math.isnan(self.mass_density) else self.mass_density

    def errors(self, values: Floats) -> Floats:
        """Simulated − measured rate [mm³/ms]."""
        return np.asarray((values - self.rate) * MM3_PER_MS)

    def misfit(self, values: Floats) -> Floats:
        """J of simulated samples: Σ |rate − measured rate| [mm³/ms], Sec. 4."""
        return np.asarray(np.sum(np.abs(values - self.rate), axis=-1) * MM3_PER_MS)

    def score(self, simulator: Simulator) -> RateScore:
        """Score of the simulator's injector as it is."""
        return RateScore(self, self.simulated(simulator, ITSELF)[0])

    def record(self, scores: Mapping[str, RateScore]) -> dict[str, Any]:
        """J, J relative to the data, and injected volume of each label."""
        level, widths = float(np.sum(np.abs(self.rate)) * MM3_PER_MS), value_widths(self)
        return {
            "samples": len(self.rate),
            **point_record(self.point),
            "J": {label: number(s.j) for label, s in scores.items()},
            "J_relative": {label: number(s.j / level) if level else None for label, s in scores.items()},
            "noise_relative": _noise(self.rate) * MM3_PER_MS / level if level else 0.0,
            "volume": {MEASURED: float(np.sum(self.rate * widths))}
            | {label: number(float(np.sum(s.values * widths))) for label, s in scores.items()},
        }


@dataclass(frozen=True)
class RateScore(Score):
    """Injection curve: simulated samples [m³/s]."""

    data: RateData

    @property
    def j(self) -> float:
        """J, Σ |error| [mm³/ms]; NaN if the simulation failed."""
        return float(self.data.misfit(self.values))

    @property
    def error(self) -> float:
        """J [mm³/ms]."""
        return self.j

    def missing(self) -> list[Missing]:
        """The one point, if its simulation failed."""
        return [] if math.isfinite(self.j) else [Missing(self.data.point)]

    def quantities(self) -> tuple[Floats, Floats]:
        """Volumes injected within the samples [m³]."""
        widths = value_widths(self.data)
        measured, simulated = (np.atleast_1d(np.sum(rate * widths)) for rate in (self.data.rate, self.values))
        return measured, simulated

    def relative_error(self) -> float:
        """Σ |error| over Σ data, without what the noise of the samples makes of it."""
        rate = self.data.rate
        return relative_to(np.sum(np.abs(self.values - rate)) - _noise(rate), np.sum(rate))

    def best_gain(self, gains: Floats) -> float:
        """Median of the ratios of data to simulation, weighted by the simulation: it makes Σ |error| least."""
        used = np.abs(self.values) > 0.0  # not where it is NaN
        if not used.any():
            return 1.0
        ratios, weights = self.data.rate[used] / self.values[used], np.abs(self.values[used])
        order = np.argsort(ratios, kind="stable")
        half = np.searchsorted(np.cumsum(weights[order]), 0.5 * np.sum(weights))
        return float(np.clip(ratios[order][half], gains[0], gains[-1]))


def _in_term(data: RateData, batch: Batch, candidates: Candidates) -> Floats:
    """Samples (candidates, samples) [m³/s] as the meter shows them; the batch has none of them."""
    return data._as_metered(candidates)


def _sum_errors(batch: Batch, candidates: Candidates) -> Floats:
    return batch.absolute_error * MM3_PER_MS


def _sum_squares(batch: Batch, candidates: Candidates) -> Floats:
    return batch.squared_error * MM3_PER_MS**2


def _samples(curves: Sequence[RateData], dt: float) -> Misfit:
    most = max(len(d.bounds) for d in curves)
    bounds, target, weight = (np.zeros((len(curves), most)) for _ in range(3))
    for i, data in enumerate(curves):
        n = len(data.bounds)
        first, last = data.point.start - 0.5 * dt, data.point.start + data.point.duration + 0.5 * dt
        if not first <= data.bounds[0] < data.bounds[-1] <= last:
            raise ConfigurationError(
                f"{data.name}: the samples' bounds must lie inside the simulated time and be one more than the samples."
            )
        bounds[i, :n] = (data.bounds - data.point.start) / dt
        target[i, 1:n] = data.rate
        weight[i, 1:n] = 1.0
    density = np.array([[d.mass_density for d in curves]])
    return Misfit(np.array([len(d.bounds) for d in curves]), bounds, target, weight, density)


def _noise(rate: Floats) -> float:
    """Σ |noise| of a sampled curve, from its second differences, which a smooth curve hardly has."""
    if len(rate) < 3:
        return 0.0
    deviation = np.median(np.abs(np.diff(rate, 2))) / (0.6745 * np.sqrt(6.0))  # white noise: σ √(1 + 4 + 1)
    return float(np.sqrt(2.0 / np.pi) * deviation * len(rate))
