"""Test plan as measured data of a study: quantities per stroke, each judged by its band."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field

from commonrail.base.arguments import Quantity, instances, settle
from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError
from commonrail.base.record import to_record
from commonrail.base.text import number
from commonrail.data.base import Missing, Role, Score, Term, ToleratedData, make_term, read_labels, relative_to
from commonrail.data.noise import Noise
from commonrail.data.quantities.data import QuantityData, point_values
from commonrail.data.quantities.returned import ReturnData
from commonrail.data.records import point_record
from commonrail.data.simulator import ITSELF, Candidates, Simulator
from commonrail.data.study_block import Context, DataModel, mass_density
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.solution import Batch
from commonrail.engine.status import OK, check_point
from commonrail.physics.injector import Injector
from commonrail.physics.meters import Meter
from commonrail.physics.variants import RETURN, reader_of, unread_inputs
from commonrail.plugins.plans.record import JudgedQuantity, PlanRecord, PlanRow, SecondEnergising
from commonrail.plugins.plans.study import Bands, Measure, PlanTest, State, TestPlan, load_plan, note_without_rate
from commonrail.readers.location import Place, locate_errors
from commonrail.readers.toml import Unit

# Residual for one half band. Makers aim at the nominal quantity, so values near it are likelier than values at the
# limits. JCGM 100:2008 (GUM), 4.3.9, uses a triangular distribution, whose standard deviation is the half band over √6:
# a quantity at its limit is off by 2.4 standard deviations.
RESIDUAL = math.sqrt(6.0)
SPECIFIED = Noise(sigma=1.0)  # the standard deviation is stated, not estimated from a few residuals


class PlanModel(DataModel):
    """Block of a test plan; `tests` selects some of its tests by name."""

    selects_rows: ClassVar[bool] = True

    kind: Literal["test plan"]
    tests: list[str] | None = Field(default=None, min_length=1, max_length=1000)
    stroke_rate: Annotated[float, Unit("1/s")] | None = None
    cylinder_pressure: Annotated[float, Unit("Pa")]
    return_pressure: Annotated[float, Unit("Pa")]


@dataclass(frozen=True, eq=False)
class PlanData(ToleratedData):
    """Tests with a nominal quantity per stroke and a band each.

    An error is the distance from the nominal quantity in half bands times `RESIDUAL`; inside a band with one limit it
    is zero. A return includes the leakage of the guides between two strokes if the stroke rate is stated.

    Attributes
    ----------
    name : str
    role : Role
    tests : tuple of PlanTest, length n
        Quantities [m³].
    points : tuple of OperatingPoint, length n
    weight : float
    source, synthetic : str
    mass_density : float or (n,)
        As in `QuantityData`.
    meter : Meter or None
        As in `QuantityData`.
    noise : Noise
        Its standard deviations are multiples of the half band over `RESIDUAL`.

    Raises
    ------
    ConfigurationError
        If an argument has the wrong type, there is no test, or a stroke is shorter than its simulation.
    """

    kind: ClassVar[str] = "test plan"
    what: ClassVar[str] = "quantity"
    unit: ClassVar[str] = "m3"
    error_head: ClassVar[tuple[str, str]] = ("rms", "half bands")
    model: ClassVar[type[PlanModel]] = PlanModel
    meter_inputs: ClassVar[frozenset[str]] = QuantityData.meter_inputs

    name: str
    role: Role
    tests: tuple[PlanTest, ...]
    points: tuple[OperatingPoint, ...]
    weight: float
    source: str
    synthetic: str
    mass_density: Floats | float = math.nan
    meter: Meter | None = None
    noise: Noise = SPECIFIED
    bands: Bands = field(init=False, repr=False, compare=False)
    parts: tuple[QuantityData, ...] = field(init=False, repr=False, compare=False)

    bounds = None

    def __post_init__(self) -> None:
        read_labels(self)
        tests = instances(self.tests, PlanTest, "tests of the data")
        points = instances(self.points, OperatingPoint, "points of the data")
        if not tests or len(points) != len(tests):
            raise ConfigurationError(f"{self.name} must have at least one test, and a point for each.")
        bands = Bands.of(tests)
        settle(
            self,
            tests=tests,
            points=points,
            simulated_points=points,
            bands=bands,
            measured=bands.middle,
            judged=np.ones(len(tests), bool),
            tolerances=np.fmin(bands.below, bands.above) / RESIDUAL,
        )
        settle(self, parts=tuple(_part(self, i) for i in range(len(tests))))

    @classmethod
    def of(
        cls,
        plan: TestPlan,
        injector: Injector,
        pressures: tuple[Quantity, Quantity],
        name: str,
        *,
        role: Role = Role.VALIDATION,
        weight: float = 1.0,
        source: str = "",
        synthetic: str = "",
        meter: Meter | None = None,
    ) -> Self:
        """Data of a plan for an injector, whose fuel converts masses to volumes.

        `pressures`: in the cylinder and at the end of the return line [Pa]; the rest as the attributes. Raises
        `ConfigurationError` if a test measures the return of an injector without one, or the fuel does not cover a
        point.
        """
        points = tuple(test.point(*pressures) for test in plan.tests)
        for test, point in zip(plan.tests, points, strict=True):
            with locate_errors(Place(plan.name, f"test {test.name}")):
                check_point(injector, point)
                if test.measure is Measure.RETURN and RETURN in unread_inputs(injector.variant):
                    cure = f"take a model with {reader_of(RETURN)}, or omit the test"
                    raise ConfigurationError(f"{injector.name} has no return to measure; {cure}.")
        if plan.unit == "m3":
            return cls(name, role, plan.tests, points, weight, source, synthetic, meter=meter)
        density = np.array([mass_density(injector, plan.unit, point) for point in points])
        tests = tuple(test.scale(1.0 / d) for test, d in zip(plan.tests, density.tolist(), strict=True))
        return cls(name, role, tests, points, weight, source, synthetic, density, meter)

    @classmethod
    def read_all(cls, model: PlanModel, context: Context) -> tuple[Self, ...]:
        """Read a plan; see `DataSet.read_all`."""
        plan = load_plan(context.path(model.file, context.at, model.form), model.form)
        with locate_errors(context.at):
            plan = plan.at_stroke_rate(model.stroke_rate)
            plan = plan if model.tests is None else plan.select(model.tests)
            note_without_rate(model.name, plan.tests)
            data = cls.of(
                plan,
                context.injector,
                (model.cylinder_pressure, model.return_pressure),
                model.name,
                role=Role(model.role),
                weight=model.weight,
                source=model.source,
                synthetic=model.synthetic,
                meter=context.meter(model.meter),
            )
            return (data,)

    @classmethod
    def terms(cls, group: Sequence[Self], time_step: float) -> list[Term]:
        """One term for each plan."""
        return [make_term(d, partial(_values, d), partial(np.not_equal, OK), to_horizon=d.to_horizon) for d in group]

    @property
    def to_horizon(self) -> bool:
        """True if a test measures the return, which continues after the end of injection."""
        return any(test.measure is Measure.RETURN for test in self.tests)

    def simulated(self, simulator: Simulator, values: Floats) -> Floats:
        """Quantities (candidates, tests) [m³]; NaN for a failed simulation, or a needle that never closes."""
        return _values(
            self, simulator.batch(self.points, values, to_horizon=self.to_horizon), Candidates(simulator, values)
        )

    def errors(self, values: Floats) -> Floats:
        """Distances of simulated values (…, n) in half bands (`Bands.excess`) times `RESIDUAL`."""
        return RESIDUAL * self.bands.excess(values)

    def discrepancy(self, values: Floats) -> Floats:
        """Half bands over `RESIDUAL` [m³]."""
        return np.broadcast_to(self.tolerances, values.shape)

    def score(self, simulator: Simulator) -> PlanScore:
        """Score of the simulator's injector as it is."""
        return PlanScore(self, self.simulated(simulator, ITSELF)[0])

    def record(self, scores: Mapping[str, PlanScore], reasons: Sequence[str | None] | None = None) -> dict[str, Any]:
        """Tests as `judge` returns them, each with the quantity of each label."""
        record: dict[str, Any] = to_record(self.judge(scores, reasons))
        values = ({label: number(float(s.values[i])) for label, s in scores.items()} for i in range(len(self.tests)))
        return record | {"rows": [value | row for value, row in zip(values, record["rows"], strict=True)]}

    def judge(self, scores: Mapping[str, PlanScore], reasons: Sequence[str | None] | None = None) -> PlanRecord:
        """Judge models by their scores, by label; `reasons` (tests,) say why the only model has no number."""
        reasons = reasons or [None] * len(self.tests)
        return PlanRecord(
            name=self.name,
            rows=tuple(_row(self, i, scores, reason) for i, reason in enumerate(reasons)),
            rms={label: score.error for label, score in scores.items()},
            inside={label: score.states.count(State.INSIDE) for label, score in scores.items()},
        )


@dataclass(frozen=True)
class PlanScore(Score):
    """Simulated quantities (tests,) [m³] of a plan."""

    data: PlanData

    @property
    def error(self) -> float:
        """Root mean square distance in half bands; a band with one limit counts its excess."""
        return float(np.sqrt(np.mean(self.data.bands.excess(self.values) ** 2)))

    @property
    def states(self) -> list[State]:
        """Place of each quantity in its band."""
        return [test.state(value) for test, value in zip(self.data.tests, self.values.tolist(), strict=True)]

    def missing(self) -> list[Missing]:
        """Tests whose simulation failed."""
        return [Missing(self.data.points[i]) for i in np.flatnonzero(np.isnan(self.values))]

    def quantities(self) -> tuple[Floats, Floats]:
        """Nominal and simulated deliveries where there are both [m³]."""
        stated = [t.measure is Measure.DELIVERY and t.nominal is not None for t in self.data.tests]
        both = np.isfinite(self.values) & np.array(stated)
        return self.data.measured[both], self.values[both]

    def best_gain(self, gains: Floats) -> float:
        """Factor on the simulated values that minimises J; 1 if all lie inside their bands."""
        return 1.0 if all(state is State.INSIDE for state in self.states) else super().best_gain(gains)

    def relative_error(self) -> float:
        """Σ |error| over Σ quantity, each in its half band; NaN for a failed simulation."""
        level = float(np.sum(np.abs(self.data.measured / self.data.tolerances)))
        return relative_to(np.sum(np.abs(self.data.errors(self.values))), level)


def _part(data: PlanData, i: int) -> QuantityData:
    """Quantity map of a single point, which simulates the quantity of a test."""
    test, density = data.tests[i], np.broadcast_to(data.mass_density, len(data.tests))
    points, middle = data.points[i : i + 1], data.measured[i : i + 1]
    dead_time = np.zeros(1, bool)
    values = f"{data.name}, test {test.name}", data.role, points, middle, float(data.tolerances[i]), 0.0, dead_time
    labels = data.weight, data.source, data.synthetic, float(density[i])
    if test.measure is Measure.DELIVERY:
        return QuantityData(*values, *labels, meter=data.meter)
    period = None if test.stroke_rate is None else 1.0 / test.stroke_rate
    return ReturnData(*values, *labels, meter=data.meter, stroke_period=period)


def _values(data: PlanData, batch: Batch, candidates: Candidates) -> Floats:
    """Quantities (candidates, tests) of a batch at the points of the tests [m³]."""
    parts = enumerate(data.parts)
    return np.concatenate([point_values(p, batch.at_points(slice(i, i + 1)), candidates) for i, p in parts], axis=1)


def _row(data: PlanData, i: int, scores: Mapping[str, PlanScore], reason: str | None) -> PlanRow:
    """Row of a test, with the quantity of each label and of the bench."""
    test = data.tests[i]
    first, *more = test.energisings
    return PlanRow(
        **point_record(data.points[i]),
        second=SecondEnergising(more[0].start - first.duration, more[0].duration) if more else None,
        name=test.name,
        measure=test.measure,
        stroke_rate=test.stroke_rate,
        nominal=test.nominal,
        lower=test.lower,
        upper=test.upper,
        band=test.band,
        models={label: _judge_quantity(test, float(score.values[i])) for label, score in scores.items()},
        bench=None if test.bench is None else _judge_quantity(test, test.bench),
        reason=reason,
    )


def _judge_quantity(test: PlanTest, value: float) -> JudgedQuantity:
    return JudgedQuantity(value, float(Bands.of([test]).distance(np.array([value]))[0]), test.state(value))
