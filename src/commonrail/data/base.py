"""Interface that every kind of measured data implements.

A kind is a frozen dataclass that derives from `DataSet` and is registered in the group "data", with a `Score` and the
model of its block in a study file. Search, journal, fleet, comparison and plausibility know these only; reports show it
by the part of the same name in the group "views".
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import partial
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from commonrail.base.arguments import Cure, enum_member, instance, number, plain_text, settle
from commonrail.base.arrays import Bools, Floats, Ints
from commonrail.base.errors import ConfigurationError
from commonrail.data.noise import NOISE, Noise
from commonrail.data.simulator import Candidates, Simulator
from commonrail.data.study_block import Context, DataModel
from commonrail.engine import lanes, plan
from commonrail.engine.lanes import Misfit
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.plan import candidate_matrix
from commonrail.engine.solution import Batch
from commonrail.physics.meters import Meter
from commonrail.physics.variants import wiring


class Role(Enum):
    """Use of a data set."""

    FIT = "fit"
    VALIDATION = "validation"


class Term(NamedTuple):
    """Data sets of one kind that a search simulates together, in one batch."""

    points: Sequence[OperatingPoint]
    weights: Floats  # (data sets,)
    misfits: Callable[[Batch, Candidates], Floats]  # J (candidates, data sets); not finite for a failed simulation
    squares: Callable[[Batch, Candidates], Floats]  # sums of the squared errors without the weights, in that shape
    failed: Callable[[Ints], Bools]  # which of the statuses (candidates, points) count as failed
    misfit: Misfit | None = None  # samples that are compared inside the simulation
    to_horizon: bool = False  # simulate to the horizon of each point, where it else ends once the injector is at rest


def make_term(
    data: DataSet,
    values: Callable[[Batch, Candidates], Floats],
    failed: Callable[[Ints], Bools],
    *,
    to_horizon: bool = False,
) -> Term:
    """Term of one data set whose errors follow from its simulated values (candidates, n).

    All functions must be picklable: terms reach the workers.
    """
    misfits, squares = partial(_misfits, data, values), partial(_squares, data, values)
    return Term(data.simulated_points, np.array([data.weight]), misfits, squares, failed, to_horizon=to_horizon)


def _misfits(
    data: DataSet, values: Callable[[Batch, Candidates], Floats], batch: Batch, candidates: Candidates
) -> Floats:
    return data.misfit(values(batch, candidates))[:, None]


def _squares(
    data: DataSet, values: Callable[[Batch, Candidates], Floats], batch: Batch, candidates: Candidates
) -> Floats:
    return np.asarray(np.sum(data.errors(values(batch, candidates)) ** 2, axis=1)[:, None])


class Missing(NamedTuple):
    """A point that has no number: name of its status and what it means, empty where the simulation is to tell them."""

    point: OperatingPoint
    status: str = ""
    sentence: str = ""


@dataclass(frozen=True)
class Score(ABC):
    """Agreement of one injector with one data set."""

    data: Any
    values: Floats  # (n,): simulated, one for each of the data set's `measured`; NaN where a simulation failed

    @property
    @abstractmethod
    def error(self) -> float:
        """The one figure that a table with a column for each data set has, see `DataSet.error_head`."""

    @abstractmethod
    def missing(self) -> list[Missing]:
        """Points that have no number."""

    @abstractmethod
    def quantities(self) -> tuple[Floats, Floats]:
        """Measured and simulated quantities per stroke [m³]."""

    @abstractmethod
    def relative_error(self) -> float:
        """Σ |error| beyond noise over Σ data; NaN for a failed simulation."""

    def best_gain(self, gains: Floats) -> float:
        """Factor among `gains` on the simulated values that makes J least; values that failed do not count."""
        return float(gains[np.argmin(self.data.misfit(self.scaled(gains)))])

    def scaled(self, gains: Floats) -> Floats:
        """Simulated values times gains, (gains, n); what failed or is not judged becomes the measured value."""
        counts = np.isfinite(self.values) & self.data.judged
        return np.where(counts, np.multiply.outer(gains, self.values), self.data.measured)

    def baselines(self, fitted: Sequence[DataSet]) -> list[dict[str, Any]]:
        """JSON-able records of trivial models of the `fitted` data, each with a sentence that compares this one."""
        return []


class DataSet(ABC):
    """Measured values at operating points."""

    cure: ClassVar[Cure] = Cure("write commonrail.RateData(…), QuantityData(…), ReturnData(…) or another kind of data")

    # of the kind
    kind: ClassVar[str]  # `kind` in a study file and in a record
    what: ClassVar[str]  # what its values are, "rate"
    unit: ClassVar[str]  # their SI unit
    error_head: ClassVar[tuple[str, str]]  # what `Score.error` is, "J", and its unit
    model: ClassVar[type[DataModel]]  # keys of its block in a study file
    meter_inputs: ClassVar[frozenset[str]]  # quantities of a meter that its values depend on
    sigma_unit: ClassVar[str] = "1"  # SI unit in which a standard deviation of its noise is stated
    residual_unit: ClassVar[str] = "tolerances"  # of its residuals, in words
    residual_scale: ClassVar[float] = 1.0  # residual for one `sigma_unit`

    name: str
    role: Role
    weight: float  # factor of its J in the objective
    source: str  # where the data come from
    synthetic: str  # what about them is synthetic, empty if measured
    points: tuple[OperatingPoint, ...]
    # all single injections that a candidate takes in a search; set by the kind, as the next two
    simulated_points: tuple[OperatingPoint, ...]
    measured: Floats  # (n,)
    judged: Bools  # (n,): values of the kind itself, without substitutes such as dead times
    # (n,) or for all: density [kg/m³] that made volumes of masses; NaN where volumes were measured
    mass_density: Floats | float
    # (n + 1,): bounds [s] of the samples, if the values are a course in time; None if there is one for each point
    bounds: Floats | None
    # law between the simulated flow and the measured values; None where they are compared as they are
    meter: Meter | None
    noise: Noise = NOISE  # for the likelihood of the data; the search does not depend on it
    has_return: bool = False  # whether a value is a quantity through the return line

    @classmethod
    @abstractmethod
    def read_all(cls, model: Any, context: Context) -> Sequence[Self]:
        """Read the data sets that a block of a study file holds, held-out ones included.

        `model`: the block, of the kind's own `model`. Raises `InputError` if a file or a value cannot be read, or makes
        no sense, and `ConfigurationError` if values contradict one another, or the data do not fit the injector.
        """

    @classmethod
    @abstractmethod
    def terms(cls, group: Sequence[Self], time_step: float) -> list[Term]:
        """All data sets of this kind in the objective of a search; the time step is in [s]."""

    @abstractmethod
    def simulated(self, simulator: Simulator, values: Floats) -> Floats:
        """Simulated values of candidates (candidates, n); NaN for a failed simulation."""

    @abstractmethod
    def errors(self, values: Floats) -> Floats:
        """Simulated − measured values (…, n) in `residual_unit`."""

    @abstractmethod
    def misfit(self, values: Floats) -> Floats:
        """J of simulated values (…, n): (…); NaN where one of them is."""

    def residuals(self, values: Floats) -> Floats:
        """Errors of simulated values (candidates, n), scaled by the root of the weight for least squares."""
        return np.asarray(np.sqrt(self.weight) * self.errors(values))

    def discrepancy(self, values: Floats) -> Floats | None:
        """Standard deviations of model and measurement about predicted values (n,); None where the kind states none."""
        return None

    @abstractmethod
    def score(self, simulator: Simulator) -> Score:
        """Score of the simulator's injector as it is."""

    @abstractmethod
    def record(self, scores: Mapping[str, Any]) -> dict[str, Any]:
        """JSON-able figures of the scores by label; the keys that all kinds have are added by the caller."""

    @property
    def samples(self) -> int:
        """Numbers that the data set holds, to limit the size of a study."""
        return len(self.measured)

    def changed(self, **attributes: Any) -> Self:
        """The same data with other attributes, as in ``changed(meter=None)``."""
        return replace(self, **attributes)  # type: ignore[type-var]  # every kind is a dataclass


class ToleratedData(DataSet):
    """Data each of whose values is judged against a tolerance of its own."""

    tolerances: Floats  # (n,): set by the kind, in the units of `measured`

    def errors(self, values: Floats) -> Floats:
        """(Value − measured)/tolerance of simulated values (…, n)."""
        return np.asarray((values - self.measured) / self.tolerances)

    def misfit(self, values: Floats) -> Floats:
        """J of simulated values: Σ 2 (√(1 + r²) − 1) over the errors r: r² for small, 2 |r| for large ones."""
        return np.asarray(np.sum(2.0 * (np.sqrt(1.0 + self.errors(values) ** 2) - 1.0), axis=-1))


def read_labels(data: DataSet) -> None:
    """Read and check what data sets of all kinds have: texts, role, weight, noise and meter."""
    for what in ("name", "source", "synthetic"):
        plain_text(getattr(data, what), f"{what} of the data")
    weight = number(data.weight, "1", "weight of the data")
    if not weight > 0.0:
        raise ConfigurationError(f"The weight of {data.name} must be greater than zero, not {weight:g}.")
    instance(data.noise, Noise, "noise of the data")
    if data.noise.relative and data.sigma_unit == "1":
        raise ConfigurationError(
            f"The noise of {data.name} has a relative part, which only curves have; state it as the relative part "
            "of the tolerance."
        )
    settle(data, role=enum_member(data.role, Role, "role of the data"), weight=weight, mass_density=data.mass_density)
    if data.meter is None:
        return
    meter = instance(data.meter, Meter, "meter of the data")
    stated = [key for key in ("density", "temperature") if key in meter.values]
    if stated and not np.isnan(data.mass_density).all():
        raise ConfigurationError(
            f"{data.name} was measured by mass, and the {stated[0]} of its meter {meter.name} has no effect on it; "
            "remove it, or give the data by volume."
        )


def is_metered(data: DataSet, simulator: Simulator) -> bool:
    """True if the simulated values are seen through a meter that changes them, or may do so."""
    return data.meter is not None and not (data.meter.neutral and not simulator.varies(data.meter))


def value_widths(data: DataSet) -> Floats:
    """Time [s] that each value counts for, or 1, (n,)."""
    return np.ones(len(data.measured)) if data.bounds is None else np.diff(data.bounds)


def relative_to(error: float, level: float) -> float:
    """Error over a level, 0 or greater; NaN for a level that is not."""
    return float(max(error, 0.0) / level) if level > 0.0 else float("nan")


# Distance by which needle and valve pass their stops in a simulation.

SHARE = 8  # candidates whose states are kept at a time: 15 MB for 3.5 ms in steps of 1 us


class Past(NamedTuple):
    """Largest distance of the plunger's top and of the valve beyond their stops (candidates,) [m].

    Greater than zero where the part touches its stop; NaN for a failed simulation.
    """

    needle: Floats
    valve: Floats


def past_stops(simulator: Simulator, point: OperatingPoint, values: Floats) -> Past:
    """Distances of candidates beyond the stops of needle and valve at an operating point.

    The stops touch at `plunger_needle.stop_lift` and `valve.lift` of each candidate; as they are springs,
    a part that rests on its stop lies beyond it.

    `values` (candidates, names) in [SI].
    """
    names, injector_values = simulator.of_injector(values)
    prepared = plan.prepare(simulator.injector, [point], simulator.time_step)
    variant = simulator.injector.wired(names)
    rows = lanes.trace_paths(variant)
    places = [rows.index(f"body.{wiring(variant).body.TOP}"), rows.index("valve.lift")]
    overtravel = np.empty((len(injector_values), 2))
    for first in range(0, len(injector_values), SHARE):
        share = slice(first, first + SHARE)
        theta = candidate_matrix(simulator.injector, names, injector_values[share])
        job = plan.make_job(prepared, theta, False)
        outcome, trace = lanes.run(job, variant, traced=True, same_bits=simulator.same_bits)
        sound = (outcome.sound * outcome.closed_at_start)[:, 0] > 0.0
        overtravel[share] = np.where(sound[:, None], trace[0][:, places, : len(theta)].max(axis=0).T, np.nan)
    stops: dict[str, Any] = {
        **simulator.injector.values,
        **{name: injector_values[:, i] for i, name in enumerate(names)},
    }
    return Past(overtravel[:, 0] - stops["plunger_needle.stop_lift"], overtravel[:, 1] - stops["valve.lift"])
