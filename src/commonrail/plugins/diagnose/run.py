"""Diagnosis of a part: which single fault explains what a bench measured, and the next test that would tell."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from commonrail.base.arguments import Quantity, fraction, instance, integer, thread_count
from commonrail.base.arrays import Floats
from commonrail.base.display import Shown
from commonrail.base.errors import InputError, SimulationError
from commonrail.base.hooks import note
from commonrail.base.text import join_words, numbers
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
    regressed,
    responses,
)
from commonrail.plugins.diagnose.faults import SEAT_LEAK, FaultTable, Parts, load_faults, shipped_faults
from commonrail.plugins.plans.data import PlanData
from commonrail.plugins.plans.page import note_without_rate
from commonrail.plugins.plans.run import injector_record
from commonrail.plugins.plans.study import BENCH_PRESSURES, Measure, PlanTest, State, TestPlan, load_plan

USUAL = 2.0  # standard deviations of measured sound parts within which makers' scatter explains a result: 95 %
DRAWS = 64  # sound parts that are simulated with each size of each fault
WORKSHOP, MAKER = "workshop", "maker"  # classes of benches


class BenchClass(NamedTuple):
    """Standard deviations of a bench and of the model's relative changes, with mark and source.

    Shares of a `delivery`, of a return (`back`), and besides of the `half_band` of a delivery.
    """

    delivery: float
    back: float
    half_band: float
    mark: str
    source: str


# Small deliveries have wide bands since they are hard to make and to measure. A return is mostly what guides leak,
# which follows the viscosity: 2 to 3 % for each kelvin.
BENCHES = {
    WORKSHOP: BenchClass(0.03, 0.10, 0.15, "E", "with the band 3 to 4 % of a usual delivery"),
    MAKER: BenchClass(0.01, 0.03, 0.0, "E", "a bench with controlled temperature, on which parts are classified"),
}
SOUND = 0.5  # probability of a sound part before the measurement
FAILS = "fails the plan"
TOLD = 0.9  # probability from which a diagnosis is stated as told; chosen
UNEXPLAINED = 1e-3  # share of parts as far away below which nothing in the table explains the quantities; chosen
TELLS = 2.0  # standard deviations from which a next test tells two diagnoses apart; chosen
GRID = (5, 5)  # rail pressures and energising times that are tried as the next test
EDGE = 0.25  # scatter of a delivery, as a share, from which its distribution is not normal; chosen
QUANTILES = (1 / 6, 1 / 2, 5 / 6)  # of a fault's size, at which the next test is simulated
SEED = 1  # of the sound parts


@dataclass(frozen=True)
class PlanBench:
    """Quantities of parts of an injector at the tests of a plan, simulated with a time step [s]."""

    injector: Injector
    data: PlanData
    time_step: float = DEFAULT_STEP
    threads: int | None = None

    def at(self, tests: Sequence[PlanTest]) -> PlanBench:
        """The bench at other tests, with its pressures; their names need not differ."""
        point, name = self.data.points[0], self.data.name
        pressures = point.at_start(point.cylinder_pressure), point.at_start(point.return_pressure)
        tests_by_name = tuple(replace(test, name=f"{test.name} ({i})") for i, test in enumerate(tests))
        return replace(self, data=PlanData.of(TestPlan(name, tests_by_name), self.injector, pressures, name))

    def _leak_per_area(self, i: int) -> float:
        """Volume per stroke that a leak of the valve's seat adds to a test, over its effective area, Eq. (4) [m].

        It leaks at rail pressure for the whole stroke, into the return line; that it lowers the pressure in the
        control chamber, by the square of its area over the Z-hole's (0.6 % at most in cri2-16 with the shipped table),
        is left out.
        """
        test, point = self.data.tests[i], self.data.points[i]
        if test.measure is not Measure.RETURN:
            return 0.0
        rail, _, low = point.initial_pressures()
        upstream, behind = self.injector.fuel.density(np.array([rail, low]), self.injector.values[FUEL_TEMPERATURE])
        period = point.duration if test.stroke_rate is None else 1.0 / test.stroke_rate
        return float(np.sqrt(2.0 * upstream * (rail - low)) / behind) * period

    def __call__(self, parts: Parts) -> Floats:
        """Quantities (parts, tests) [m³] of parts without noise; NaN where a simulation failed."""
        columns = [j for j, name in enumerate(parts.names) if name != SEAT_LEAK]
        simulator = Simulator(self.injector, [parts.names[j] for j in columns], self.time_step, self.threads)
        quantities = self.data.simulated(simulator, parts.values[:, columns])
        if SEAT_LEAK in parts.names:
            leaks = np.array([self._leak_per_area(i) for i in range(len(self.data.tests))])
            quantities = quantities + parts.values[:, [parts.names.index(SEAT_LEAK)]] * leaks
        return quantities


class NextTest(NamedTuple):
    """Test that is not in the plan: expected quantity under two diagnoses [m³], and how many standard deviations apart.

    `names`, `expected` and `deviation`: of the first and the second diagnosis; `sound`: quantity of the part as drawn.
    All are the model's, which a plan's nominal quantities do not scale: it states none here.
    """

    test: PlanTest
    sound: float
    names: tuple[str, str]
    expected: tuple[float, float]
    deviation: tuple[float, float]
    separation: float


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
        Tests that tell the two leading diagnoses apart best, the best first; empty where one is told already.
    noise, sound : float
        As they were stated; the noise may be a class of `BENCHES`.
    time_step : float
        [s].
    factors : (tests,)
        Of the model's quantities: 1, or what makes sound parts have the plan's nominal quantities.
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
        """The diagnoses that together have `TOLD`: one where it is told, else those that cannot be told apart."""
        names, total = list(self.probabilities), np.cumsum([*self.probabilities.values()])
        return tuple(names[: int(np.searchsorted(total, TOLD)) + 1])

    @property
    def verdict(self) -> str:
        """ "sound", the name of a fault, "cannot be told", or "unexplained" where even the best one hardly fits.

        `FAILS` in place of "sound" where a result lies outside its band.
        """
        if self.judged.fit[self.judged.order[0]] < UNEXPLAINED:
            return "unexplained"
        if len(self.leading) > 1:
            return "cannot be told"
        fails = any(state is not State.INSIDE for state in _states(self.data))
        return FAILS if fails and self.leading == ("sound",) else self.leading[0]

    def size(self, name: str) -> tuple[float, float, float]:
        """Median and 90 % interval of a fault's size, between 0, its least, and 1, its most."""
        i = [r.name for r in self.responses].index(name)
        return tuple(_quantile(self.responses[i], self.judged.weights[i], q) for q in (0.5, 0.05, 0.95))  # type: ignore[return-value]

    def record(self) -> dict[str, Any]:
        """JSON-able form, SI units."""
        judged, best = self.judged, self.judged.order[0]
        sound, leading = self.responses[0], self.responses[best]
        at = int(np.argmax(judged.weights[best]))
        rows = [
            {
                "test": test.name,
                "measure": test.measure.value,
                "rail_pressure": test.rail_pressure,
                "energising_time": test.energisings[0].duration,
                "measured": test.bench,
                "sound": float(sound.mean[0, j]),
                "deviation": float(self._deviation[j]),
                "leading": float(leading.mean[at, j]),
                "state": state.value,
                "usual": bool(abs(test.bench - sound.mean[0, j]) <= USUAL * self._deviation[j]),
            }
            for j, (test, state) in enumerate(zip(self.data.tests, _states(self.data), strict=True))
        ]
        return {
            **record_head("diagnosis", f"Diagnosis: {self.data.name}", self.data.synthetic),
            "injector": injector_record(self.injector),
            "plan": self.data.name,
            "noise": self.noise,
            "sound": self.sound,
            "nominal": bool(np.any(self.factors != 1.0)),
            "time_step": self.time_step,
            "verdict": self.verdict,
            "leading": list(self.leading),
            "diagnoses": [self._row(i) for i in judged.order],
            "tests": rows,
            "next": [_next_record(item) for item in self.next],
        }

    @property
    def _deviation(self) -> Floats:
        """Standard deviation of each quantity of measured sound parts (tests,) [m³]."""
        sound = self.responses[0]
        noise = bench_noise(self.data.tests, self.noise)
        return np.hypot(np.sqrt(np.diag(sound.scatter[0])), noise.deviation(sound.mean[0]))

    def _row(self, i: int) -> dict[str, Any]:
        response = self.responses[i]
        row = {
            "name": response.name,
            "probability": float(self.judged.probabilities[i]),
            "fit": float(self.judged.fit[i]),
        }
        if response.fault is None:
            return {**row, "meaning": "within makers' tolerances", "parameter": "", "size": [], "source": ""}
        sizes = [response.fault.size_text(self.injector, s) for s in self.size(response.name)]
        source = f"{response.fault.source.mark}: {response.fault.source.text}"
        return {
            **row,
            "meaning": response.fault.meaning,
            "parameter": response.fault.names[0],
            "size": sizes,
            "source": source,
        }


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
    """Find the single fault that explains what a bench measured, with probabilities over faults and "sound".

    Parameters
    ----------
    injector : Injector
        A sound part as drawn.
    results : TestPlan or path
        Test plan with a column bench; tests without a result are left out.
    faults : FaultTable or path, optional
        Table of faults and of the scatter of sound parts; by default the one that ships.
    noise : float or str
        Standard deviation of the bench and of the model's own error: a share of each quantity, or a class of `BENCHES`,
        "workshop" or "maker".
    sound : float or str
        Probability before the measurement that the part is sound; all faults are equally likely.
    nominal : bool
        Take the plan's nominal quantities for those of a sound part, where it states them, and the model for the
        relative changes alone.
    stroke_rate, cylinder_pressure, return_pressure, time_step
        As of `plan`.
    draws : int
        Sound parts that are simulated with each size of each fault.
    threads : int, optional
        All usable processors by default; the result does not depend on it.

    Raises
    ------
    InputError, ConfigurationError
        If a file cannot be read, fewer than two tests have a result, or an argument is of another kind.
    SimulationError
        If sound parts cannot be simulated.
    """
    instance(injector, Injector, "injector")
    table = read_table(faults)
    share, prior = read_noise(noise), fraction(sound, "sound")
    step, count = check_step(time_step), integer(draws, "draws", 40, 4096)
    plan = results if isinstance(results, TestPlan) else load_plan(results)
    data = measured_tests(plan.at_stroke_rate(stroke_rate), injector, (cylinder_pressure, return_pressure))
    note_without_rate(data.name, data.tests)
    parts, centre = sound_parts(injector, table, count)
    bench = PlanBench(injector, data, step, thread_count(threads))
    fault_responses = responses(injector, parts, centre, visible_faults(injector, data, table), bench)
    if not fault_responses:
        raise SimulationError(f"Hardly any sound part can be simulated at the tests of {data.name}.")
    _note_edges(data, fault_responses[0])
    factors = nominal_factors(data, fault_responses[0].mean[0]) if nominal else np.ones(len(data.tests))
    fault_responses = tuple(r.scaled(factors) for r in fault_responses)
    measured = np.array([test.bench for test in data.tests], float)
    fails = [state is not State.INSIDE for state in _states(data)]
    judged = judge(fault_responses, measured, bench_noise(data.tests, share), prior, fails=fails)
    result = Diagnosis(injector, data, fault_responses, judged, (), share, prior, step, factors)
    if len(result.leading) == 1:
        return result
    return replace(result, next=next_tests(result, bench, parts, centre))


def _states(data: PlanData) -> list[State]:
    return [test.state(test.bench or 0.0) for test in data.tests]


def bench_noise(tests: Sequence[PlanTest], noise: float | str = WORKSHOP) -> BenchNoise:
    """Noise of a bench at tests [m³]: a share of each quantity, or that of a class of `BENCHES`.

    A band counts where a delivery has two limits; others have the least of these.
    """
    if isinstance(noise, float):
        return BenchNoise(noise)
    bench = BENCHES[noise]
    closed = [test.measure is Measure.DELIVERY and None not in (test.lower, test.upper) for test in tests]
    bands = [min(test.half_bands) if full else math.inf for test, full in zip(tests, closed, strict=True)]
    floors = bench.half_band * np.where(closed, bands, min(bands)) if any(closed) else np.zeros(len(tests))
    shares = [bench.delivery if test.measure is Measure.DELIVERY else bench.back for test in tests]
    return BenchNoise(np.array(shares), np.maximum(floors, RESOLUTION))


def read_noise(noise: float | str) -> float | str:
    """Class of a bench, or the share of a text or number."""
    return noise if noise in BENCHES else fraction(noise, "noise")


def _note_edges(data: PlanData, sound: Response) -> None:
    """Note deliveries that scatter too much among sound parts: not all of them inject there."""
    wide = np.sqrt(np.diag(sound.scatter[0])) > EDGE * sound.mean[0]
    names = [t.name for t, far in zip(data.tests, wide, strict=True) if far and t.measure is Measure.DELIVERY]
    if names:
        note(
            f"{data.name}: sound parts scatter by more than {100.0 * EDGE:.0f} % at {join_words(names)}, at the edge "
            "of injection; the probabilities are surer than they should be: take longer energising times there."
        )


def read_table(faults: FaultTable | str | PathLike[str] | None) -> FaultTable:
    """Table that is given or lies in a file; the one that ships for None."""
    if faults is None:
        return shipped_faults()
    return faults if isinstance(faults, FaultTable) else load_faults(Path(faults))


def nominal_factors(data: PlanData, sound: Floats) -> Floats:
    """Nominal quantities over those of sound parts (tests,) [1]; 1 where the plan states none."""
    nominal = np.array([math.nan if test.nominal is None else test.nominal for test in data.tests])
    if not np.isfinite(nominal).any():
        raise InputError(f"{data.name} states no nominal quantity; add the column nominal, or compare with the model.")
    return np.where(np.isfinite(nominal) & (sound > RESOLUTION), nominal / np.maximum(sound, RESOLUTION), 1.0)


def measured_tests(plan: TestPlan, injector: Injector, pressures: tuple[Quantity, Quantity]) -> PlanData:
    """Tests of a plan that have a result; `InputError` if there are fewer than two."""
    with_result = tuple(test for test in plan.tests if test.bench is not None)
    if len(with_result) < 2:
        raise InputError(
            f"{plan.name}: {len(with_result)} of {len(plan.tests)} tests have a result in the column bench, "
            "and at least two "
            "are needed."
        )
    if len(with_result) < len(plan.tests):
        left = [test.name for test in plan.tests if test.bench is None]
        note(f"{plan.name}: {join_words(left)} {'has' if len(left) == 1 else 'have'} no result in the column bench.")
    return PlanData.of(replace(plan, tests=with_result), injector, pressures, plan.name, synthetic=plan.synthetic)


def visible_faults(injector: Injector, data: PlanData, table: FaultTable) -> tuple[Any, ...]:
    """Faults whose parameters the model has, and that a test can show: a leak of the seat needs a return."""
    returns = any(test.measure is Measure.RETURN for test in data.tests)
    return tuple(f for f in table.of_model(injector) if returns or set(f.names) != {SEAT_LEAK})


def sound_parts(injector: Injector, table: FaultTable, count: int) -> tuple[Parts, Floats]:
    """Sound parts, evenly drawn (a Sobol' sequence), and the part as drawn in the parameters that scatter [SI].

    `InputError` if the table states the scatter of no parameter that the model reads.
    """
    from scipy.special import ndtri  # slow to import
    from scipy.stats import qmc

    scatter = table.scatter_of(injector)
    if not scatter:
        raise InputError(f"The table of faults states the scatter of no parameter that {injector.name} reads.")
    middle = np.array([injector.values[name] for name in scatter])
    sequence = qmc.Sobol(len(scatter), rng=np.random.default_rng(SEED))
    shares = np.clip(sequence.random(1 << (count - 1).bit_length())[:count], 1e-12, 1.0 - 1e-12)
    return Parts(tuple(scatter), middle + ndtri(shares) * np.array([*scatter.values()])), middle


# The next test: of a grid of points between those of the plan the one where the two leading diagnoses, each with the
# sizes that its quantities leave, differ most in standard deviations of what is expected of them.


def next_tests(diagnosis: Diagnosis, bench: PlanBench, parts: Parts, centre: Floats) -> tuple[NextTest, ...]:
    """The three best tests of a grid, the best first."""
    tests, n = _candidates(diagnosis.data, diagnosis.injector), len(diagnosis.data.tests)
    first, second = diagnosis.judged.order[:2]
    tried = bench.at((*diagnosis.data.tests, *tests))
    expected = [_expected(diagnosis, i, tried, parts, centre, n) for i in (first, second)]
    simulated_pairs = [pair for pair in expected if pair is not None]
    if len(simulated_pairs) < 2:
        return ()
    (mean, deviation), (other, spread) = simulated_pairs
    separation = np.abs(mean - other) / np.hypot(deviation, spread)
    sound = tried(Parts((), np.empty((1, 0))))[0, n:]
    names = diagnosis.responses[first].name, diagnosis.responses[second].name
    columns = (values.tolist() for values in (sound, mean, other, deviation, spread, separation))
    rows = [NextTest(t, q, names, (a, b), (c, d), s) for t, q, a, b, c, d, s in zip(tests, *columns, strict=True)]
    return tuple(rows[k] for k in np.argsort(-separation, kind="stable")[:3].tolist())


def _candidates(data: PlanData, injector: Injector) -> list[PlanTest]:
    """Tests of a grid between the least and the greatest rail pressure and energising time of the plan."""
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


def _expected(
    diagnosis: Diagnosis, i: int, bench: PlanBench, parts: Parts, centre: Floats, n: int
) -> tuple[Floats, Floats] | None:
    """Mean and standard deviation of the tests behind the first n, given the results of these (tests,) [m³]."""
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
        gain, left = regressed(covariance, n)
        means.append(mean[n:] + gain @ (measured - mean[:n]))
        variances.append(left)
    if not means:
        return None
    middle = np.mean(means, axis=0)
    return middle, np.sqrt(np.maximum(np.mean(variances, axis=0) + np.var(means, axis=0), 0.0))


def _next_record(item: NextTest) -> dict[str, Any]:
    test = item.test
    return {
        "rail_pressure": test.rail_pressure,
        "energising_time": test.energisings[0].duration,
        "measure": test.measure.value,
        "stroke_rate": test.stroke_rate,
        "names": list(item.names),
        "sound": numbers([item.sound])[0],
        "expected": list(item.expected),
        "deviation": list(item.deviation),
        "separation": item.separation,
        "tells": item.separation >= TELLS,
    }
