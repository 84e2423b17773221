"""Interface that every kind of measured data implements.

A kind is a frozen dataclass that derives from `DataSet`, has the methods below and stands in `data.kinds.KINDS`.
Search, journal, fleet, comparison, plausibility and report know these methods only.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from enum import Enum
from typing import Any, ClassVar, NamedTuple, Protocol, Self

import numpy as np

from commonrail.base.arguments import chosen, instance, number, plain_text, settle
from commonrail.base.arrays import Bools, Floats, Ints
from commonrail.base.chart import Figure
from commonrail.base.errors import ConfigurationError
from commonrail.base.table import Table
from commonrail.data.noise import NOISE, Noise
from commonrail.data.records import Plotted, Record, Texts
from commonrail.data.simulator import Candidates, Simulator
from commonrail.data.study_block import Context, DataModel
from commonrail.engine import lanes, plan
from commonrail.engine.lanes import Misfit
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.plan import candidate_matrix
from commonrail.engine.solution import Batch
from commonrail.physics.meters import Meter
from commonrail.physics.variants import wiring
from commonrail.readers.location import Place


class Role(Enum):
    """Use of a data set."""

    FIT = "fit"
    VALIDATION = "validation"


class Term(NamedTuple):
    """Data sets of one kind that a search simulates together, in one batch.

    Attributes
    ----------
    points : sequence of OperatingPoint
    weights : (data sets,)
    misfits : function of Batch and Candidates
        J of each data set, (candidates, data sets); not finite for a failed simulation.
    squares : function of Batch and Candidates
        Sum of the squared residuals of each data set without its weight, in the same shape.
    failed : function of (candidates, points) statuses
        Which simulations count as failed.
    misfit : Misfit or None
        Samples that are compared inside the simulation.
    whole : bool
        Simulate to the horizon of each point, where a simulation else ends once the injector is at rest.
    """

    points: Sequence[OperatingPoint]
    weights: Floats
    misfits: Callable[[Batch, Candidates], Floats]
    squares: Callable[[Batch, Candidates], Floats]
    failed: Callable[[Ints], Bools]
    misfit: Misfit | None = None
    whole: bool = False


class Score(Protocol):
    """Agreement of one injector with one data set."""

    @property
    def values(self) -> Floats:
        """Simulated values, one for each of the data set's `measured`; NaN where a simulation failed."""

    @property
    def error(self) -> float:
        """The one figure that a table with a column for each data set has, see `DataSet.error_head`."""


class Missing(NamedTuple):
    """A point that has no number: name of its status and what it means, empty where the simulation is to tell them."""

    point: OperatingPoint
    status: str = ""
    sentence: str = ""


class View(ABC):
    """Content of reports on records of one kind: tables, figures and sentences, as plain data."""

    @abstractmethod
    def has(self, data: Record, label: str) -> bool:
        """True if a model has any number for the data set."""

    @abstractmethod
    def operating_point(self, data: Record) -> Record:
        """One of the data set's operating points, to simulate it again."""

    def operating_points(self, data: Record) -> Sequence[Record]:
        """All of the data set's operating points."""
        return [self.operating_point(data)]

    @abstractmethod
    def sentences(self, data: Sequence[Record]) -> list[str]:
        """Ends of sentences on the agreement of a calibrated model with data sets."""

    @abstractmethod
    def leading(self, data: Sequence[Record]) -> tuple[str, list[Mapping[str, Any]]]:
        """Measure of the best model of a comparison, and the errors by label of each data set."""

    @abstractmethod
    def tables(self, data: Sequence[Record], texts: Texts) -> list[Table]:
        """Tables of a calibration; errors and shares are those of the label "best", whatever its text."""

    @abstractmethod
    def compared_tables(self, data: Sequence[Record], labels: Sequence[str]) -> list[Table]:
        """Tables of a comparison: a column for each model, the least error of each row marked."""

    @abstractmethod
    def figures(self, data: Record, plotted: Plotted) -> list[Figure]:
        """Figures of one data set of a calibration."""

    @abstractmethod
    def compared_figures(self, data: Record, plotted: Plotted) -> list[Figure]:
        """Figures of one data set of a comparison."""


class DataSet(ABC):
    """Measured values at operating points.

    Attributes
    ----------
    kind : str
        Of the kind: `kind` in a study file and in a record.
    what, unit : str
        Of the kind: what its values are, "rate", and their SI unit.
    error_head : (str, str)
        Of the kind: what `Score.error` is, "J", and its unit.
    model : type of DataModel
        Of the kind: keys of its block in a study file.
    view : View
        Of the kind: what reports show of it.
    seen : set of str
        Of the kind: quantities of a meter that its values depend on.
    sigma_unit, residual_unit : str
        Of the kind: SI unit in which a standard deviation of its noise is stated, and unit of its residuals in words.
    residual_scale : float
        Of the kind: residual for one `sigma_unit`.
    name, source, synthetic : str
        Where the data come from; what about them is synthetic, empty if measured.
    role : Role
    weight : float
        Factor of its J in the objective.
    points : tuple of OperatingPoint
    measured : (n,)
        Measured values.
    bounds : (n + 1,) or None
        Bounds [s] of the samples, if the values are a course in time; None if there is one for each point.
    judged : (n,) bool
        Values of the kind itself; not those that stand for another figure, such as a dead time.
    mass_density : float or (n,)
        Density [kg/m³] that made volumes of masses; NaN where volumes were measured.
    meter : Meter or None
        Law between the simulated flow and the measured values; None where they are compared as they are.
    noise : Noise
        Noise model for the likelihood of the data; the search does not depend on it.
    """

    kind: ClassVar[str]
    what: ClassVar[str]
    unit: ClassVar[str]
    error_head: ClassVar[tuple[str, str]]
    model: ClassVar[type[DataModel]]
    view: ClassVar[View]
    seen: ClassVar[frozenset[str]]
    sigma_unit: ClassVar[str] = "1"
    residual_unit: ClassVar[str] = "tolerances"
    residual_scale: ClassVar[float] = 1.0

    name: str
    role: Role
    weight: float
    source: str
    synthetic: str
    points: tuple[OperatingPoint, ...]
    mass_density: Floats | float
    bounds: Floats | None
    meter: Meter | None
    noise: Noise = NOISE

    @classmethod
    @abstractmethod
    def read(cls, model: Any, context: Context) -> Self:
        """Read a data set.

        Parameters
        ----------
        model : DataModel
            Its block in the study file, of the kind's own `model`.
        context : Context

        Raises
        ------
        InputError
            If a file or a value cannot be read, or makes no sense.
        ConfigurationError
            If values contradict one another, or the data do not fit the injector.
        """

    @classmethod
    def read_all(cls, model: Any, context: Context) -> Sequence[Self]:
        """Read all data sets that a block of a study file holds; see `read`."""
        return (cls.read(model, context),)

    @property
    def injections(self) -> int:
        """Single injections that a candidate takes in a search."""
        return len(self.points)

    @classmethod
    @abstractmethod
    def terms(cls, group: Sequence[Self], time_step: float) -> list[Term]:
        """All data sets of this kind in the objective of a search."""

    @property
    @abstractmethod
    def measured(self) -> Floats:
        """Measured values (n,)."""

    @property
    def judged(self) -> Bools:
        """Mask of the values that are of the kind itself, (n,)."""
        return np.ones(len(self.measured), bool)

    @property
    def widths(self) -> Floats:
        """Time [s] that each value counts for, or 1, (n,)."""
        return np.ones(len(self.measured)) if self.bounds is None else np.diff(self.bounds)

    @abstractmethod
    def simulated(self, simulator: Simulator, values: Floats) -> Floats:
        """Simulated values of candidates (candidates, n); NaN for a failed simulation."""

    @abstractmethod
    def misfit(self, values: Floats) -> Floats:
        """J of simulated values (…, n): (…); NaN where one of them is."""

    @abstractmethod
    def residuals(self, values: Floats) -> Floats:
        """Residuals of simulated values (candidates, n) for least squares, scaled by the root of the weight."""

    def discrepancy(self, values: Floats) -> Floats | None:
        """Standard deviations of model and measurement about predicted values (n,); None where the kind states none."""
        return None

    @abstractmethod
    def score(self, simulator: Simulator) -> Score:
        """Score of the simulator's injector as it is."""

    @abstractmethod
    def missing(self, score: Any) -> list[Missing]:
        """Points that have no number."""

    @abstractmethod
    def quantities(self, score: Any) -> tuple[Floats, Floats]:
        """Measured and simulated quantities per stroke [m³]."""

    @abstractmethod
    def relative_error(self, score: Any) -> float:
        """Σ |error| beyond noise over Σ data; NaN for a failed simulation."""

    def best_gain(self, score: Any, gains: Floats) -> float:
        """Factor among `gains` on the simulated values that makes J least; values that failed do not count."""
        return float(gains[np.argmin(self.misfit(self.scaled(score.values, gains)))])

    def scaled(self, values: Floats, gains: Floats) -> Floats:
        """Simulated values (n,) times gains, (gains, n); what failed or is not judged becomes the measured value."""
        counts = np.isfinite(values) & self.judged
        return np.where(counts, np.multiply.outer(gains, values), self.measured)

    @abstractmethod
    def record(self, scores: Mapping[str, Any]) -> dict[str, Any]:
        """JSON-able figures of the scores by label; the keys that all kinds have are added by the caller."""

    def divided(self, model: Any, at: Place) -> tuple[Self, ...]:
        """The data set itself, or the parts that its block in a study file asks for: fitted and held out.

        Parameters
        ----------
        model : DataModel
        at : Place
            Of the block.
        """
        return (self,)

    def baselines(self, fitted: Sequence[DataSet], score: Any) -> list[dict[str, Any]]:
        """JSON-able records of trivial models for data of validation, each with a sentence that compares a model.

        Parameters
        ----------
        fitted : sequence of DataSet
            Data of the fit.
        score : Score
            Of the model on this data set.
        """
        return []

    def is_metered(self, simulator: Simulator) -> bool:
        """True if the simulated values are seen through a meter that changes them, or may do so."""
        return self.meter is not None and not (self.meter.neutral and not simulator.varies(self.meter))

    def with_meter(self, meter: Meter | None) -> Self:
        """The same data with another meter."""
        return replace(self, meter=meter)  # type: ignore[type-var]  # every kind is a dataclass

    def with_noise(self, noise: Noise) -> Self:
        """The same data with another noise model."""
        return replace(self, noise=noise)  # type: ignore[type-var]  # every kind is a dataclass

    def renamed(self, name: str) -> Self:
        """The same data by another name."""
        return replace(self, name=name)  # type: ignore[type-var]  # every kind is a dataclass

    @property
    def samples(self) -> int:
        """Numbers that the data set holds, to limit the size of a study."""
        return len(self.measured)

    def _settle_labels(self) -> None:
        """Read what data sets of all kinds have."""
        for what in ("name", "source", "synthetic"):
            plain_text(getattr(self, what), f"{what} of the data")
        weight = number(self.weight, "1", "weight of the data")
        if not weight > 0.0:
            raise ConfigurationError(f"The weight of {self.name} must be greater than zero, not {weight:g}.")
        instance(self.noise, Noise, "noise of the data")
        if self.noise.relative and self.sigma_unit == "1":
            raise ConfigurationError(
                f"The noise of {self.name} has a relative part, which only curves have; state it as the relative part "
                "of the tolerance."
            )
        settle(self, role=chosen(self.role, Role, "role of the data"), weight=weight)
        if self.meter is not None:
            self._check_meter(instance(self.meter, Meter, "meter of the data"))

    def _check_meter(self, meter: Meter) -> None:
        """Refuse a density of the meter for what was measured by mass."""
        given = [key for key in ("density", "temperature") if key in meter.values]
        if given and not np.isnan(self.mass_density).all():
            raise ConfigurationError(
                f"{self.name} was measured by mass, and the {given[0]} of its meter {meter.name} has no effect on it; "
                "remove it, or give the data by volume."
            )


def share_of(error: float, level: float) -> float:
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

    The stops touch at `plunger_needle.stop_lift` and `valve.lift` of each candidate; they give way as springs, so that
    a part that rests on its stop lies beyond it.

    Parameters
    ----------
    simulator : Simulator
    point : OperatingPoint
    values : (candidates, names)
        [SI].
    """
    names, own = simulator.of_injector(values)
    prepared = plan.prepare(simulator.injector, [point], simulator.time_step)
    variant = simulator.injector.wired(names)
    rows = lanes.trace_paths(variant)
    places = [rows.index(f"body.{wiring(variant).body.TOP}"), rows.index("valve.lift")]
    found = np.empty((len(own), 2))
    for first in range(0, len(own), SHARE):
        part = slice(first, first + SHARE)
        theta = candidate_matrix(simulator.injector, names, own[part])
        job = plan.make_job(prepared, theta, False)
        outcome, trace = lanes.run(job, variant, traced=True, same_bits=simulator.same_bits)
        sound = (outcome.sound * outcome.closed_at_start)[:, 0] > 0.0
        found[part] = np.where(sound[:, None], trace[0][:, places, : len(theta)].max(axis=0).T, np.nan)
    of = _values_of(simulator, names, own)
    return Past(found[:, 0] - of("plunger_needle.stop_lift"), found[:, 1] - of("valve.lift"))


def _values_of(simulator: Simulator, names: tuple[str, ...], own: Floats) -> Callable[[str], Floats | float]:
    """Function that returns a parameter of each candidate, or of the injector where it does not vary."""
    columns = {name: own[:, i] for i, name in enumerate(names)}
    return lambda name: columns.get(name, simulator.injector.values[name])
