"""Diagnosis of a part: the single fault that explains the results of a bench, and the test that would decide next."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np

from commonrail.base.arguments import Quantity, fraction, instance, integer, thread_count
from commonrail.base.arrays import Floats
from commonrail.base.display import Shown
from commonrail.base.errors import InputError, SimulationError
from commonrail.base.hooks import note
from commonrail.base.record import Key, to_record
from commonrail.base.text import join_words
from commonrail.data.records import record_head
from commonrail.data.simulator import Simulator
from commonrail.engine.operating_point import Energising
from commonrail.engine.time_step import DEFAULT_STEP, check_step
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector
from commonrail.physics.variants import RETURN, unread_inputs
from commonrail.plugins.diagnose.evidence import (
    RESOLUTION,
    BenchNoise,
    Judged,
    Response,
    judge,
    moments,
    regress_on_first,
    responses,
)
from commonrail.plugins.diagnose.faults import SEAT_LEAK, FaultTable, Parts, load_faults, load_shipped_faults
from commonrail.plugins.plans.data import PlanData
from commonrail.plugins.plans.run import InjectorFacts
from commonrail.plugins.plans.study import (
    BENCH_PRESSURES,
    Measure,
    PlanTest,
    State,
    TestPlan,
    load_plan,
    note_without_rate,
)

USUAL = 2.0  # standard deviations of measured sound parts; a result within this limit is makers' scatter (95 %)
DRAWS = 64  # sound parts simulated for each size of each fault
WORKSHOP, MAKER = "workshop", "maker"  # classes of benches


class BenchClass(NamedTuple):
    """Standard deviations of a bench and of the model's relative changes, with mark and source.

    They are shares of a `delivery`, of a return (`back`), and of the `half_band` of a delivery, added in quadrature.
    """

    delivery: float
    back: float
    half_band: float
    mark: str
    source: str


# Small deliveries are hard to make and to measure, so their bands are wide. A return is mostly leakage of the guides,
# which depends on the viscosity: 2 to 3 % per kelvin.
BENCHES = {
    WORKSHOP: BenchClass(0.03, 0.10, 0.15, "E", "with the band 3 to 4 % of a usual delivery"),
    MAKER: BenchClass(0.01, 0.03, 0.0, "E", "a bench with controlled temperature, on which parts are classified"),
}
SOUND = 0.5  # probability of a sound part before the measurement
FAILS = "fails the plan"
UNDECIDED, UNEXPLAINED = "undecided", "unexplained"  # verdicts if no diagnosis is stated
STATED = 0.9  # probability from which a diagnosis is stated; chosen
LEAST_FIT = 1e-3  # share of parts at least as far away, below which the fault does not explain the quantities; chosen
DECIDES = 2.0  # standard deviations by which a next test must separate two diagnoses; chosen
GRID = (5, 5)  # rail pressures and energising times of the candidates for the next test
EDGE = 0.25  # relative scatter of a delivery above which its distribution is not normal; chosen
QUANTILES = (1 / 6, 1 / 2, 5 / 6)  # quantiles of a fault's size for the simulation of the next test
SEED = 1  # of the sound parts


@dataclass(frozen=True)
class PlanBench:
    """Quantities of parts of an injector at the tests of a plan, simulated with a time step [s]."""

    injector: Injector
    data: PlanData
    time_step: float = DEFAULT_STEP
    threads: int | None = None

    def at(self, tests: Sequence[PlanTest]) -> PlanBench:
        """Return this bench with other tests at the same pressures; equal names are made distinct."""
        point, name = self.data.points[0], self.data.name
        pressures = point.at_start(point.cylinder_pressure), point.at_start(point.return_pressure)
        tests_by_name = tuple(replace(test, name=f"{test.name} ({i})") for i, test in enumerate(tests))
        return replace(self, data=PlanData.of(TestPlan(name, tests_by_name), self.injector, pressures, name))

    def _leak_per_area(self, i: int) -> float:
        """Leaked volume per stroke and effective area of the leaking valve seat, Eq. (4) [m].

        The seat leaks at rail pressure into the return line for the whole stroke. The drop of pressure in the control
        chamber, by the squared ratio of the leak's area to the Z-hole's (at most 0.6 % in cri2-16 with the shipped
        table), is neglected.
        """
        test, point = self.data.tests[i], self.data.points[i]
        if test.measure is not Measure.RETURN:
            return 0.0
        rail, _, low = point.initial_pressures()
        upstream, downstream = self.injector.fuel.density(np.array([rail, low]), self.injector.values[FUEL_TEMPERATURE])
        period = point.duration if test.stroke_rate is None else 1.0 / test.stroke_rate
        return float(np.sqrt(2.0 * upstream * (rail - low)) / downstream) * period

    def __call__(self, parts: Parts) -> Floats:
        """Quantities of parts at the tests, without noise (parts, tests) [m³]; NaN where a simulation failed."""
        columns = [j for j, name in enumerate(parts.names) if name != SEAT_LEAK]
        simulator = Simulator(self.injector, [parts.names[j] for j in columns], self.time_step, self.threads)
        quantities = self.data.simulated(simulator, parts.values[:, columns])
        if SEAT_LEAK in parts.names:
            leaks = np.array([self._leak_per_area(i) for i in range(len(self.data.tests))])
            quantities = quantities + parts.values[:, [parts.names.index(SEAT_LEAK)]] * leaks
        return quantities


class NextTest(NamedTuple):
    """Candidate for the next test: its quantity under two diagnoses.

    `names`, `expected` and `deviation` [m³]: of the first and the second diagnosis; `sound`: quantity of the part as
    drawn [m³]; `separation`: distance of the two in standard deviations. All come from the model alone: the plan states
    no nominal quantity for such a test.
    """

    test: PlanTest
    names: tuple[str, str]
    sound: float
    expected: tuple[float, float]
    deviation: tuple[float, float]
    separation: float

    @property
    def decides(self) -> bool:
        """True if the test separates the two diagnoses."""
        return self.separation >= DECIDES

    def record(self) -> dict[str, Any]:
        """JSON-able form, SI units."""
        facts: dict[str, object] = {
            "rail_pressure": self.test.rail_pressure,
            "energising_time": self.test.energisings[0].duration,
            "measure": self.test.measure,
            "stroke_rate": self.test.stroke_rate,
            "names": self.names,
            "sound": self.sound,
            "expected": self.expected,
            "deviation": self.deviation,
            "separation": self.separation,
            "tells": self.decides,
        }
        return to_record(facts)


class PossibleDiagnosis(NamedTuple):
    """Diagnosis with its probability and its `fit`, the share of parts that lie as far from their mean.

    `size`: middle and ends of the 90 % interval of the fault's `parameter` as texts; empty for a sound part.
    """

    name: str
    probability: float
    fit: float
    meaning: str
    parameter: str
    size: tuple[str, ...]
    source: str


class MeasuredTest(NamedTuple):
    """Quantities of a test [m³]: measured, mean and standard deviation of sound parts, and with the leading diagnosis.

    `usual`: whether sound parts scatter as far as the measured quantity.
    """

    name: Annotated[str, Key("test")]
    measure: Measure
    rail_pressure: float
    energising_time: float
    measured: float
    sound: float
    deviation: float
    leading: float
    state: State
    usual: bool


@dataclass(frozen=True, repr=False)
class Diagnosis(Shown):
    """Diagnosis of a part.

    Attributes
    ----------
    injector : Injector
    data : PlanData
        The tests that the bench measured.
    responses : tuple of Response
        Of sound parts and of each fault that the model can show.
    judged : Judged
        Probabilities in that order, and the distribution over the sizes of each fault.
    next : tuple of NextTest
        Tests that best separate the two leading diagnoses, best first; empty if one diagnosis is stated.
    noise, sound : float
        Arguments of `diagnose`; the noise is a share or a class of `BENCHES`.
    time_step : float
        [s].
    factors : (tests,)
        Factors on the model's quantities: 1, or those that give sound parts the plan's nominal quantities.
    """

    presenter = "commonrail.plugins.diagnose.page:DIAGNOSIS"

    injector: Injector
    data: PlanData
    responses: tuple[Response, ...]
    judged: Judged
    next: tuple[NextTest, ...]
    noise: float | str
    sound: float
    time_step: float
    factors: Floats | float = 1.0

    @property
    def probabilities(self) -> dict[str, float]:
        """Probability of each diagnosis, "sound" among them, the most probable first."""
        return {self.responses[i].name: float(self.judged.probabilities[i]) for i in self.judged.order}

    @property
    def leading(self) -> tuple[str, ...]:
        """The most probable diagnoses that together reach `STATED`; several if none is stated."""
        names, total = list(self.probabilities), np.cumsum([*self.probabilities.values()])
        return tuple(names[: int(np.searchsorted(total, STATED)) + 1])

    @property
    def verdict(self) -> str:
        """Name of a fault, "sound", `FAILS`, `UNDECIDED`, or `UNEXPLAINED` if even the best diagnosis hardly fits.

        `FAILS` replaces "sound" if a result lies outside its band.
        """
        if self.judged.fit[self.judged.order[0]] < LEAST_FIT:
            return UNEXPLAINED
        if len(self.leading) > 1:
            return UNDECIDED
        fails = any(state is not State.INSIDE for state in _states(self.data))
        return FAILS if fails and self.leading == ("sound",) else self.leading[0]

    def size(self, name: str) -> tuple[float, float, float]:
        """Median and 90 % interval of a fault's size, from 0 (its least) to 1 (its most)."""
        i = [r.name for r in self.responses].index(name)
        return tuple(_quantile(self.responses[i], self.judged.weights[i], q) for q in (0.5, 0.05, 0.95))  # type: ignore[return-value]

    def record(self) -> dict[str, Any]:
        """JSON-able form, SI units."""
        facts: dict[str, object] = {
            "injector": InjectorFacts.of(self.injector),
            "plan": self.data.name,
            "noise": self.noise,
            "sound": self.sound,
            "nominal": self.by_nominal,
            "time_step": self.time_step,
            "verdict": self.verdict,
            "leading": self.leading,
            "diagnoses": self.diagnoses,
            "tests": self.tests,
            "next": [test.record() for test in self.next],
        }
        return record_head("diagnosis", f"Diagnosis: {self.data.name}", self.data.synthetic) | to_record(facts)

    @property
    def by_nominal(self) -> bool:
        """True if the plan's nominal quantities are those of a sound part."""
        return bool(np.any(self.factors != 1.0))

    @cached_property
    def tests(self) -> tuple[MeasuredTest, ...]:
        """Measured quantities next to those of sound parts and of the leading diagnosis."""
        sound, best = self.responses[0], self.judged.order[0]
        leading = self.responses[best].mean[np.argmax(self.judged.weights[best])]
        noise = bench_noise(self.data.tests, self.noise).deviation(sound.mean[0])
        columns = (sound.mean[0], np.hypot(np.sqrt(np.diag(sound.scatter[0])), noise), leading)
        rows = zip(self.data.tests, _states(self.data), *(column.tolist() for column in columns), strict=True)
        return tuple(
            MeasuredTest(
                name=test.name,
                measure=test.measure,
                rail_pressure=test.rail_pressure,
                energising_time=test.energisings[0].duration,
                measured=test.bench or 0.0,
                sound=mean,
                deviation=deviation,
                leading=faulty,
                state=state,
                usual=abs((test.bench or 0.0) - mean) <= USUAL * deviation,
            )
            for test, state, mean, deviation, faulty in rows
        )

    @cached_property
    def diagnoses(self) -> tuple[PossibleDiagnosis, ...]:
        """All diagnoses, the most probable first."""
        return tuple(map(self._diagnosis, self.judged.order))

    def _diagnosis(self, i: int) -> PossibleDiagnosis:
        response, fault = self.responses[i], self.responses[i].fault
        numbers = response.name, float(self.judged.probabilities[i]), float(self.judged.fit[i])
        if fault is None:
            return PossibleDiagnosis(*numbers, "within makers' tolerances", "", (), "")
        sizes = tuple(fault.size_text(self.injector, size) for size in self.size(fault.name))
        source = f"{fault.source.mark}: {fault.source.text}"
        return PossibleDiagnosis(*numbers, fault.meaning, fault.names[0], sizes, source)


def diagnose(
    injector: Injector,
    results: TestPlan | str | PathLike[str],
    *,
    faults: FaultTable | str | PathLike[str] | None = None,
    noise: float | str = WORKSHOP,
    sound: float | str = SOUND,
    nominal: bool = False,
    stroke_rate: Quantity | None = None,
    cylinder_pressure: Quantity = BENCH_PRESSURES[0],
    return_pressure: Quantity = BENCH_PRESSURES[1],
    time_step: Quantity = DEFAULT_STEP,
    draws: int = DRAWS,
    threads: int | None = None,
) -> Diagnosis:
    """Find the single fault that explains the results of a bench, with probabilities over faults and "sound".

    Parameters
    ----------
    injector : Injector
        A sound part as drawn.
    results : TestPlan or path
        Test plan with a column bench; tests without a result are ignored.
    faults : FaultTable or path, optional
        Table of faults and of the scatter of sound parts; default: the shipped one.
    noise : float or str
        Standard deviation of bench and model: a share of each quantity, or a class of `BENCHES`, "workshop" or "maker".
    sound : float or str
        Prior probability that the part is sound; all faults are equally likely.
    nominal : bool
        Take the plan's nominal quantities as those of a sound part, and only relative changes from the model.
    stroke_rate, cylinder_pressure, return_pressure, time_step
        As in `plan`.
    draws : int
        Sound parts simulated for each size of each fault.
    threads : int, optional
        All usable processors by default; the result does not depend on it.

    Raises
    ------
    InputError, ConfigurationError
        If a file cannot be read, fewer than two tests have a result, or an argument has the wrong type.
    SimulationError
        If sound parts cannot be simulated.
    """
    instance(injector, Injector, "injector")
    table = read_table(faults)
    share, prior = read_noise(noise), fraction(sound, "sound")
    step, count = check_step(time_step), integer(draws, "draws", 40, 4096)
    plan = results if isinstance(results, TestPlan) else load_plan(results)
    data = take_measured_tests(plan.at_stroke_rate(stroke_rate), injector, (cylinder_pressure, return_pressure))
    note_without_rate(data.name, data.tests)
    parts, centre = sound_parts(injector, table, count)
    bench = PlanBench(injector, data, step, thread_count(threads))
    fault_responses = responses(injector, parts, centre, visible_faults(injector, data, table), bench)
    if not fault_responses:
        raise SimulationError(f"Hardly any sound part can be simulated at the tests of {data.name}.")
    _note_edges(data, fault_responses[0])
    factors = nominal_factors(data, fault_responses[0].mean[0]) if nominal else np.ones(len(data.tests))
    fault_responses = tuple(r.scale(factors) for r in fault_responses)
    measured = np.array([test.bench for test in data.tests], float)
    fails = [state is not State.INSIDE for state in _states(data)]
    judged = judge(fault_responses, measured, bench_noise(data.tests, share), prior, fails=fails)
    result = Diagnosis(
        injector=injector,
        data=data,
        responses=fault_responses,
        judged=judged,
        next=(),
        noise=share,
        sound=prior,
        time_step=step,
        factors=factors,
    )
    if len(result.leading) == 1:
        return result
    return replace(result, next=next_tests(result, bench, parts, centre))


def _states(data: PlanData) -> list[State]:
    return [test.state(test.bench or 0.0) for test in data.tests]


def bench_noise(tests: Sequence[PlanTest], noise: float | str = WORKSHOP) -> BenchNoise:
    """Noise of a bench at tests [m³], from a share of each quantity or a class of `BENCHES`.

    A class includes a share of the half band of each delivery with two limits; other tests use the smallest such share.
    """
    if isinstance(noise, float):
        return BenchNoise(noise)
    bench = BENCHES[noise]
    closed = [test.measure is Measure.DELIVERY and None not in (test.lower, test.upper) for test in tests]
    bands = [min(test.half_bands) if full else math.inf for test, full in zip(tests, closed, strict=True)]
    floors = bench.half_band * np.where(closed, bands, min(bands)) if any(closed) else np.zeros(len(tests))
    shares = [bench.delivery if test.measure is Measure.DELIVERY else bench.back for test in tests]
    return BenchNoise(np.array(shares), np.maximum(floors, RESOLUTION))


def read_noise(noise: float | str, what: str = "noise") -> float | str:
    """Class of a bench, or share from a text or number; `what`: name of the argument in words."""
    return noise if noise in BENCHES else fraction(noise, what)


def _note_edges(data: PlanData, sound: Response) -> None:
    """Note deliveries that scatter too much: some sound parts do not inject there."""
    wide = np.sqrt(np.diag(sound.scatter[0])) > EDGE * sound.mean[0]
    names = [t.name for t, far in zip(data.tests, wide, strict=True) if far and t.measure is Measure.DELIVERY]
    if names:
        note(
            f"{data.name}: sound parts scatter by more than {100.0 * EDGE:.0f} % at {join_words(names)}, since some "
            "hardly inject there; the probabilities are too certain: take longer energising times."
        )


def read_table(faults: FaultTable | str | PathLike[str] | None) -> FaultTable:
    """Table as given or from a file; None: the shipped one."""
    if faults is None:
        return load_shipped_faults()
    return faults if isinstance(faults, FaultTable) else load_faults(Path(faults))


def nominal_factors(data: PlanData, sound: Floats) -> Floats:
    """Nominal quantities over quantities of sound parts (tests,) [1]; 1 if the plan states no nominal quantity."""
    nominal = np.array([math.nan if test.nominal is None else test.nominal for test in data.tests])
    if not np.isfinite(nominal).any():
        raise InputError(f"{data.name} states no nominal quantity; add the column nominal, or compare with the model.")
    return np.where(np.isfinite(nominal) & (sound > RESOLUTION), nominal / np.maximum(sound, RESOLUTION), 1.0)


def take_measured_tests(plan: TestPlan, injector: Injector, pressures: tuple[Quantity, Quantity]) -> PlanData:
    """Tests of a plan with a result; `InputError` if fewer than two have one."""
    with_result = tuple(test for test in plan.tests if test.bench is not None)
    if len(with_result) < 2:
        raise InputError(
            f"{plan.name}: {len(with_result)} of {len(plan.tests)} tests have a result in the column bench; at least "
            "two are needed."
        )
    if len(with_result) < len(plan.tests):
        left = [test.name for test in plan.tests if test.bench is None]
        note(f"{plan.name}: {join_words(left)} {'has' if len(left) == 1 else 'have'} no result in the column bench.")
    return PlanData.of(replace(plan, tests=with_result), injector, pressures, plan.name, synthetic=plan.synthetic)


def visible_faults(injector: Injector, data: PlanData, table: FaultTable) -> tuple[Any, ...]:
    """Faults whose parameters the model has and that a test can show: a seat leak needs a return."""
    returns = any(test.measure is Measure.RETURN for test in data.tests)
    return tuple(f for f in table.of_model(injector) if returns or set(f.names) != {SEAT_LEAK})


def sound_parts(injector: Injector, table: FaultTable, count: int) -> tuple[Parts, Floats]:
    """Sound parts from a Sobol' sequence, and the nominal values of the parameters that scatter [SI].

    `InputError` if the model reads none of the parameters whose scatter the table states.
    """
    from scipy.special import ndtri  # slow to import
    from scipy.stats import qmc

    deviations = table.deviations(injector)
    if not deviations:
        raise InputError(
            f"The table of faults states scatter only for parameters that {injector.name} does not read; add others."
        )
    nominal = np.array([injector.values[name] for name in deviations])
    sequence = qmc.Sobol(len(deviations), rng=np.random.default_rng(SEED))
    shares = np.clip(sequence.random(1 << (count - 1).bit_length())[:count], 1e-12, 1.0 - 1e-12)
    return Parts(tuple(deviations), nominal + ndtri(shares) * np.array([*deviations.values()])), nominal


# The next test: the point of a grid inside the plan's range where the predictions of the two leading diagnoses differ
# most, in standard deviations. The prediction of a diagnosis uses the distribution of sizes given the measured
# quantities.


def next_tests(diagnosis: Diagnosis, bench: PlanBench, parts: Parts, centre: Floats) -> tuple[NextTest, ...]:
    """The three best tests of a grid, the best first."""
    tests, n = _candidates(diagnosis.data, diagnosis.injector), len(diagnosis.data.tests)
    first, second = diagnosis.judged.order[:2]
    tried = bench.at((*diagnosis.data.tests, *tests))
    expected = [_predict_tests(diagnosis, i, tried, parts, centre, n) for i in (first, second)]
    simulated_pairs = [pair for pair in expected if pair is not None]
    if len(simulated_pairs) < 2:
        return ()
    (mean, deviation), (other, spread) = simulated_pairs
    separation = np.abs(mean - other) / np.hypot(deviation, spread)
    sound = tried(Parts((), np.empty((1, 0))))[0, n:]
    names = diagnosis.responses[first].name, diagnosis.responses[second].name
    columns = (values.tolist() for values in (sound, mean, other, deviation, spread, separation))
    rows = [NextTest(t, names, q, (a, b), (c, d), s) for t, q, a, b, c, d, s in zip(tests, *columns, strict=True)]
    return tuple(rows[k] for k in np.argsort(-separation, kind="stable")[:3].tolist())


def _candidates(data: PlanData, injector: Injector) -> list[PlanTest]:
    """Tests on a grid from the lowest to the highest rail pressure and energising time of the plan."""
    times = [t.energisings[0].duration for t in data.tests if t.measure is Measure.DELIVERY] or [0.3e-3, 1e-3]
    pressures = [test.rail_pressure for test in data.tests]
    rates = [test.stroke_rate for test in data.tests if test.stroke_rate is not None]
    pairs = [
        (round(p / 1e6) * 1e6, round(t / 10e-6) * 10e-6)
        for p in np.linspace(min(pressures), max(pressures), GRID[0]).tolist()
        for t in np.linspace(min(times), max(times), GRID[1]).tolist()
    ]
    measures = [Measure.DELIVERY] if RETURN in unread_inputs(injector.variant) else list(Measure)
    return [
        PlanTest(f"{i}", p, (Energising(0.0, t),), None, None, 1.0, measure, rates[0] if rates else None)
        for i, (p, t) in enumerate(dict.fromkeys(pairs))
        for measure in measures
    ]


def _quantile(response: Response, weights: Floats, share: float) -> float:
    return float(response.sizes[min(int(np.searchsorted(np.cumsum(weights), share)), len(weights) - 1)])


def _predict_tests(
    diagnosis: Diagnosis, i: int, bench: PlanBench, parts: Parts, centre: Floats, n: int
) -> tuple[Floats, Floats] | None:
    """Mean and standard deviation of the tests after the first n, given the results of the first n (tests,) [m³]."""
    response, weights = diagnosis.responses[i], diagnosis.judged.weights[i]
    measured = np.array([test.bench for test in diagnosis.data.tests], float) / diagnosis.factors
    noise = bench_noise((*diagnosis.data.tests, *bench.data.tests[n:]), diagnosis.noise)
    means, variances = [], []
    sizes = [0.0] if response.fault is None else [_quantile(response, weights, q) for q in QUANTILES]
    for size in sizes:
        faulty_parts = parts if response.fault is None else parts.with_fault(diagnosis.injector, response.fault, size)
        pair = moments(parts, centre, bench(faulty_parts))
        if pair is None:
            continue
        mean, scatter = pair
        covariance = scatter + np.diag(noise.deviation(mean) ** 2)
        gain, left = regress_on_first(covariance, n)
        means.append(mean[n:] + gain @ (measured - mean[:n]))
        variances.append(left)
    if not means:
        return None
    middle = np.mean(means, axis=0)
    return middle, np.sqrt(np.maximum(np.mean(variances, axis=0) + np.var(means, axis=0), 0.0))
