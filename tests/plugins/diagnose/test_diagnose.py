"""Diagnosis: evidence by hand, the table of faults, planted faults that are found, and the next test."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import t

from commonrail.base.choices import Drive
from commonrail.base.errors import CommonrailError, InputError
from commonrail.base.text import to_signed
from commonrail.engine.operating_point import Energising, OperatingPoint
from commonrail.engine.simulate import simulate
from commonrail.physics.injector import Injector
from commonrail.plugins.diagnose.evidence import FREEDOM, RESOLUTION, BenchNoise, Response, judge, moments
from commonrail.plugins.diagnose.faults import (
    SEAT_LEAK,
    Change,
    Fault,
    FaultTable,
    Parts,
    load_faults,
    load_shipped_faults,
)
from commonrail.plugins.diagnose.page import diagnosis_lines
from commonrail.plugins.diagnose.run import (
    BENCHES,
    FAILS,
    UNDECIDED,
    UNEXPLAINED,
    WORKSHOP,
    Diagnosis,
    PlanBench,
    bench_noise,
    diagnose,
    sound_parts,
)
from commonrail.plugins.plans.data import PlanData
from commonrail.plugins.plans.run import plan as run_plan
from commonrail.plugins.plans.study import Measure, PlanTest, TestPlan
from commonrail.readers.injector import load_injector
from tests.cli.conftest import Command

RATE, CYLINDER, BACK = 1000.0 / 60.0, 0.5e6, 0.1e6
SPRING, NOZZLE, LIFT = "weak valve spring", "coked nozzle", "grown armature lift"
ROWS = (
    ("VL", 160, 700, "delivery"),
    ("EM", 80, 500, "delivery"),
    ("VE", 80, 350, "delivery"),
    ("VL", 160, 700, "return"),
)
HEAD = "test,rail_pressure [MPa],energising_time [us],measure,upper_limit [mm3],bench [mm3]"


def plan(*bench: float | None) -> TestPlan:
    """Four tests with results [mm³]."""
    tests = [
        PlanTest(
            name,
            p * 1e6,
            (Energising(0.0, t * 1e-6),),
            None,
            None,
            1.0,
            Measure(measure),
            RATE,
            q if q is None else q * 1e-9,
        )
        for (name, p, t, measure), q in zip(ROWS, bench or (1.0,) * 4, strict=True)
    ]
    return TestPlan("plan", tuple(tests))


def results(injector: Injector) -> TestPlan:
    """The tests as `run_plan` simulates them: not by the code that diagnoses."""
    values = run_plan(injector, plan(), cylinder_pressure=CYLINDER, return_pressure=BACK, threads=1).score.values
    return plan(*(1e9 * values).tolist())


def fault(name: str) -> Fault:
    return next(f for f in load_shipped_faults().faults if f.name == name)


def diagnosed(injector: Injector, bench: TestPlan, faults: FaultTable, **how: Any) -> Diagnosis:
    """Diagnosis with few parts, at the pressures of the results, which a good bench measured."""
    how = {"noise": 0.01, "cylinder_pressure": CYLINDER, "return_pressure": BACK} | how
    return diagnose(injector, bench, faults=faults, draws=40, threads=1, **how)


@pytest.fixture(scope="module")
def injector() -> Injector:
    drawn = load_injector("virtual-lino-2016")
    return replace(drawn, variant=drawn.variant._replace(drive=Drive.REGULATED))


@pytest.fixture(scope="module")
def table() -> FaultTable:
    return FaultTable(tuple(map(fault, (NOZZLE, SPRING, LIFT))), load_shipped_faults().scatter)


def found(injector: Injector, table: FaultTable, **changes: float) -> Diagnosis:
    part = injector.with_values(
        {k.replace("__", "."): injector.values[k.replace("__", ".")] * v for k, v in changes.items()}
    )
    return diagnosed(injector, results(part), table)


@pytest.mark.parametrize("freedom", [FREEDOM, 5.0])
def test_probabilities_are_those_of_an_integral_over_the_size(freedom: float) -> None:
    sizes = np.linspace(0.0, 1.0, 201)
    sound = Response(None, np.zeros(1), np.array([[10e-9]]), np.array([[[0.3e-9**2]]]))
    weak = Response(fault(SPRING), sizes, (11e-9 + 4e-9 * sizes)[:, None], np.full((201, 1, 1), 0.5e-9**2))
    judged = judge([sound, weak], np.array([10.9e-9]), BenchNoise(0.02), 0.8, freedom=freedom)

    def density(middle: float, scatter: float) -> float:
        deviation = math.hypot(scatter, 0.02 * middle, 1e9 * RESOLUTION)
        return float(t.pdf(10.9, freedom, middle, deviation * math.sqrt(1.0 - 2.0 / freedom)))

    one, many = density(10.0, 0.3), quad(lambda s: density(11.0 + 4.0 * s, 0.5), 0.0, 1.0)[0]
    # the sum over 201 sizes, the ends counted whole, stands for the integral
    assert judged.probabilities[1] == pytest.approx(0.2 * many / (0.2 * many + 0.8 * one), rel=0.015)
    assert judged.probabilities.sum() == pytest.approx(1.0)
    assert 0.1 < judged.probabilities[1] < 0.9
    weights = judge([sound, weak], np.array([13e-9]), BenchNoise(0.02), 0.8).weights[1]
    assert sizes[np.argmax(weights)] == pytest.approx(0.5, abs=0.03)


@pytest.mark.parametrize("fails", [True, False])
def test_no_fault_is_likely_that_moves_a_result_the_other_way(fails: bool) -> None:
    """Below sound parts the widest distribution is densest, which a fault has that only adds."""
    sizes = np.linspace(0.0, 1.0, 11)
    sound = Response(None, np.zeros(1), np.array([[10e-9, 5e-9]]), np.array([np.diag([0.3e-9, 1e-9]) ** 2]))
    means, wide = np.column_stack([11e-9 + 4e-9 * sizes, np.full(11, 5e-9)]), np.diag([3e-9, 1e-9]) ** 2
    more = Response(fault(LIFT), sizes, means, np.tile(wide, (11, 1, 1)))
    less = Response(fault(NOZZLE), sizes, means * (-0.1, 1.0) + (10e-9, 0.0), np.tile(sound.scatter[0], (11, 1, 1)))
    noise, measured = BenchNoise(0.01, 0.3e-9), np.array([9.3e-9 if fails else 6e-9, 5e-9])
    judged = judge([sound, more, less], measured, noise, 0.5, fails=[fails, False])
    assert judged.probabilities[1] == 0.0
    assert np.isfinite(judged.weights[1]).all()
    assert judged.probabilities[2] > 0.0
    assert fails == (judge([sound, more, less], measured, noise, 0.5).probabilities[1] > 0.0)


def test_a_workshop_measures_small_deliveries_and_returns_less_well() -> None:
    bands = ((0.8e-9, 1.2e-9), (None, 1.0), (4e-9, 6e-9), (1e-9, 9e-9))  # of a return last
    tests = [replace(test, lower=low, upper=high) for test, (low, high) in zip(plan().tests, bands, strict=True)]
    (delivery, back, band, *_), noise = BENCHES[WORKSHOP], bench_noise(tests)
    np.testing.assert_allclose(noise.deviation(np.zeros(4)), band * np.array([0.2e-9, 0.2e-9, 1e-9, 0.2e-9]))
    np.testing.assert_allclose(noise.shares, [delivery, delivery, delivery, back])
    assert bench_noise(tests, 0.02) == BenchNoise(0.02)


def test_a_part_that_fails_its_plan_is_not_just_sound(injector: Injector, table: FaultTable) -> None:
    exact = results(injector)
    bands = [(0.99, 1.01, "sound"), (1.001, 1.01, FAILS)]
    for low, high, verdict in bands:
        tests = tuple(
            replace(t, nominal=None, lower=low * (t.bench or 0), upper=high * (t.bench or 0)) for t in exact.tests
        )
        assert diagnosed(injector, replace(exact, tests=tests), table, sound=0.99).verdict == verdict


def test_moments_of_linear_quantities_are_exact_with_few_parts() -> None:
    random, centre = np.random.default_rng(3), np.array([2.0, 5.0, 0.0])
    values = centre + random.standard_normal((20, 3)) * (0.1, 0.3, 0.2)
    matrix = random.standard_normal((3, 2))
    made = moments(Parts(("a", "b", "c"), values), centre, 7.0 + (values - centre) @ matrix)
    assert made is not None
    np.testing.assert_allclose(made[0], 7.0, rtol=1e-12)
    np.testing.assert_allclose(made[1], matrix.T @ np.cov(values, rowvar=False) @ matrix, rtol=1e-9)


def test_parts_that_cannot_be_simulated_leave_no_moments() -> None:
    parts = Parts(("a",), np.ones((20, 1)) + np.arange(20)[:, None])
    assert moments(parts, np.ones(1), np.where(np.arange(20) < 8, 1.0, np.nan)[:, None]) is None


def test_a_fault_changes_each_part_by_share_or_by_difference(injector: Injector) -> None:
    both = Fault("two", "", (Change("valve.lift", 0.1, 0.5, True), Change(SEAT_LEAK, 1e-10, 3e-10, False)))
    changed = Parts(("valve.lift",), np.array([[40e-6], [50e-6]])).with_fault(injector, both, np.array([0.0, 0.5]))
    assert changed.names == ("valve.lift", SEAT_LEAK)
    np.testing.assert_allclose(changed.values, [[44e-6, 1e-10], [65e-6, 2e-10]])


def test_a_leak_of_the_seat_is_a_jet_for_the_whole_stroke(injector: Injector) -> None:
    bench = PlanBench(injector, PlanData.of(plan(), injector, (CYLINDER, BACK), "plan"), threads=1)
    parts = Parts((SEAT_LEAK,), np.array([[0.0], [5e-10]]))
    tight, leaking = bench(parts)
    np.testing.assert_array_equal(tight[:3], leaking[:3])  # deliveries
    by_hand = 5e-10 * math.sqrt(2.0 * 160e6 / 830.0) / RATE  # incompressible
    assert leaking[3] - tight[3] == pytest.approx(by_hand, rel=0.08)


@pytest.mark.parametrize("pressure", [80e6, 160e6])
def test_a_needle_with_a_wider_seat_opens_later_and_injects_less(pressure: float, injector: Injector) -> None:
    """As the table says in words: the pressure in the nozzle lifts by the area outside the seat alone."""
    change, sound = fault("worn needle seat").changes[0], injector.values["needle_seat.diameter"]
    worn = injector.with_values({change.name: float(change.of(np.array(sound), 1.0))})
    drawn, wider = (simulate(part, OperatingPoint(pressure, 500e-6)) for part in (injector, worn))
    assert drawn.opening is not None
    assert wider.opening is not None
    assert drawn.opening + 10e-6 < wider.opening
    assert wider.injected_mass < 0.99 * drawn.injected_mass


@pytest.mark.parametrize(
    ("name", "parameter", "factor"),
    [(NOZZLE, "nozzle__hole_diameter", 0.92), (SPRING, "valve__spring_preload", 0.75)],
)
def test_a_planted_fault_is_found_with_its_size(
    name: str, parameter: str, factor: float, injector: Injector, table: FaultTable
) -> None:
    diagnosis = found(injector, table, **{parameter: factor})
    assert diagnosis.verdict == name
    assert diagnosis.probabilities[name] > 0.9
    change = fault(name).changes[0]
    _, low, high = (change.least + s * (change.most - change.least) for s in diagnosis.size(name))
    assert min(low, high) <= factor - 1.0 <= max(low, high)


def test_a_sound_part_is_sound_and_a_strange_one_unexplained(injector: Injector, table: FaultTable) -> None:
    assert next(iter(found(injector, table).probabilities)) == "sound"
    strange = found(injector, table, control_chamber__z_hole_diameter=1.2, nozzle__hole_diameter=1.2)
    assert strange.verdict == UNEXPLAINED
    assert "--nominal" in diagnosis_lines(strange)[0]
    assert "--nominal" not in diagnosis_lines(replace(strange, factors=1.1))[0]


def test_equal_faults_are_undecided_and_a_next_test_is_named(injector: Injector, table: FaultTable) -> None:
    twin = fault(SPRING)._replace(name="twin")
    diagnosis = found(injector, table._replace(faults=(fault(SPRING), twin)), valve__spring_preload=0.75)
    assert diagnosis.verdict == UNDECIDED
    assert set(diagnosis.leading) == {SPRING, "twin"}
    assert diagnosis.next[0].separation < 0.1  # no test can tell what is the same


def test_what_a_next_test_will_measure_follows_from_the_results(injector: Injector, table: FaultTable) -> None:
    """Of a part whose A-hole is two standard deviations too large besides."""
    own = injector.values
    spring, hole = 0.75 * own["valve.spring_preload"], 1.016 * own["control_chamber.a_hole_diameter"]
    part = injector.with_values({"valve.spring_preload": spring, "control_chamber.a_hole_diameter": hole})
    twins = table._replace(faults=(fault(SPRING), fault(SPRING)._replace(name="twin")))
    diagnosis = diagnosed(injector, results(part), twins)
    tried = [item for item in diagnosis.next if item.test.measure is Measure.DELIVERY]
    plan = TestPlan("next", tuple(item.test for item in tried))
    true = run_plan(part, plan, cylinder_pressure=CYLINDER, return_pressure=BACK, threads=1).score.values
    off = [(item.expected[0] - q) / item.deviation[0] for item, q in zip(tried, true.tolist(), strict=True)]
    assert np.abs(off).max() < 2.5
    shares = [item.deviation[0] / q for item, q in zip(tried, true.tolist(), strict=True)]
    assert max(shares) < 0.03  # less than by the tolerances alone
    sound = run_plan(injector, plan, cylinder_pressure=CYLINDER, return_pressure=BACK, threads=1).score.values
    assert [item.sound for item in tried] == pytest.approx(sound.tolist(), rel=1e-9)


def softened(injector: Injector, scale: float) -> TestPlan:
    """Results of a part with a weak spring beside nominal quantities, both on a bench that shows them times a scale."""
    soft = injector.with_values({"valve.spring_preload": 0.75 * injector.values["valve.spring_preload"]})
    part, own = results(soft), results(injector)
    tests = [
        replace(test, nominal=scale * sound.bench, bench=scale * test.bench)
        for test, sound in zip(part.tests, own.tests, strict=True)
        if sound.bench is not None and test.bench is not None
    ]
    return replace(part, tests=tuple(tests))


def test_nominal_quantities_take_the_place_of_the_model(injector: Injector, table: FaultTable) -> None:
    scaled = diagnosed(injector, softened(injector, 1.3), table, nominal=True)
    plain = diagnosed(injector, softened(injector, 1.0), table)
    assert scaled.verdict == plain.verdict == SPRING
    assert scaled.size(SPRING)[0] == pytest.approx(plain.size(SPRING)[0], abs=0.05)
    assert diagnosed(injector, softened(injector, 1.3), table).verdict != SPRING


@pytest.mark.parametrize("nominal", [True, False])
def test_beside_nominal_quantities_a_next_test_is_told_by_shares_of_a_sound_part(
    nominal: bool, injector: Injector, table: FaultTable
) -> None:
    """On a bench that shows 1.3 of the model's quantities these alone would mislead."""
    twins = table._replace(faults=(fault(SPRING), fault(SPRING)._replace(name="twin")))
    diagnosis = diagnosed(injector, softened(injector, 1.3 if nominal else 1.0), twins, nominal=nominal)
    first = diagnosis.next[0]
    drawn = run_plan(
        injector, TestPlan("next", (first.test,)), cylinder_pressure=CYLINDER, return_pressure=BACK, threads=1
    )
    share = f"{to_signed(100.0 * (first.expected[0] / drawn.score.values[0] - 1.0), 1)} %"
    assert (share in diagnosis_lines(diagnosis)[-1]) == nominal


def test_sound_parts_scatter_as_the_table_says(injector: Injector, table: FaultTable) -> None:
    parts, middle = sound_parts(injector, table, 256)
    np.testing.assert_allclose(parts.values.mean(axis=0), middle, rtol=5e-3)
    spread = [table.scatter[name] * injector.values[name] for name in parts.names]
    np.testing.assert_allclose(parts.values.std(axis=0), spread, rtol=0.05)
    with pytest.raises(InputError, match=injector.name):
        sound_parts(injector, table._replace(scatter={"solenoid.eddy_lag": 0.1}), 64)  # which is 0 there


FAULT = '[[fault]]\nname = "f"\nmeaning = "m"\nchanges = [{{ name = "valve.lift", least = {}, most = {} }}]\n'
CHANGE = '{ name = "valve.lift", least = "1 um", most = "5 um" }'
LIFTED = FAULT.format('"10 %"', '"80 %"')
TOLERANCE = '[[tolerance]]\nname = "valve.lift"\nsigma = "3 %"\n'


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (FAULT.format('"5 %"', '"2 um"') + TOLERANCE, ("fault[1].changes[1]",)),
        (FAULT.format('"5 %"', '"2 %"') + TOLERANCE, ("fault[1].changes[1]",)),
        (FAULT.format('"-5 %"', '"20 %"') + TOLERANCE, ("fault[1].changes[1]", "sign")),
        (FAULT.format('"5 bar"', '"20 bar"') + TOLERANCE, ("least", "bar")),
        (FAULT.format('"-5 %"', '"-120 %"') + TOLERANCE, ("fault[1].changes[1]", "-100 %")),
        (FAULT.format('"5 %"', '"20 %"').replace("lift", "lit") + TOLERANCE, ("valve.lift",)),
        (FAULT.format('"5 %"', '"20 %"') * 2 + TOLERANCE, ("fault[2]", '"f"')),
        (FAULT.format('"5 %"', '"20 %"') + TOLERANCE.replace("3 %", "60 %"), ("sigma", "50 %")),
        (FAULT.format('"5 %"', '"20 %"'), ("tolerance",)),
        (LIFTED + TOLERANCE * 2, ("tolerance[2]", "valve.lift")),
        (
            LIFTED.replace("changes = [", "changes = [" + CHANGE + ", ") + TOLERANCE,
            ("fault[1].changes[2]", "valve.lift"),
        ),
    ],
)
def test_a_senseless_table_of_faults_is_refused(text: str, words: tuple[str, ...], tmp_path: Path) -> None:
    file = tmp_path / "faults.toml"
    file.write_text(f'format = "commonrail-faults/1"\n{text}', encoding="utf-8")
    with pytest.raises(CommonrailError) as caught:
        load_faults(file)
    assert all(word in str(caught.value) for word in ("faults.toml", *words)), str(caught.value)


@pytest.mark.parametrize(("rate", "told"), [(None, 1), (RATE, 0)])
def test_a_return_without_a_stroke_rate_is_noted(
    injector: Injector, table: FaultTable, rate: float | None, told: int
) -> None:
    without = replace(results(injector), tests=tuple(replace(t, stroke_rate=None) for t in results(injector).tests))
    with warnings.catch_warnings(record=True) as notes:
        warnings.simplefilter("always")
        diagnosed(injector, without, table, stroke_rate=rate)
    assert ["VL (return)" in str(one.message) for one in notes] == [True] * told


def test_a_plan_without_results_is_refused(injector: Injector) -> None:
    with pytest.raises(InputError, match=r"\b1 of 4 tests\b"):
        diagnose(injector, plan(1.0, None, None, None))


def test_the_verb_prints_json_writes_a_report_and_refuses(command: Command, tmp_path: Path, injector: Injector) -> None:
    file, faults, report = (tmp_path / name for name in ("results.csv", "faults.toml", "page.html"))
    rows = [
        f"{t.name},{p},{e},{m},100,{1e9 * (t.bench or 0.0)}"
        for t, (_, p, e, m) in zip(results(injector).tests, ROWS, strict=True)
    ]
    file.write_text("\n".join(["# SYNTHETIC part", HEAD, *rows]), encoding="utf-8")
    faults.write_text(f'format = "commonrail-faults/1"\n{LIFTED}{TOLERANCE}')
    how = ["virtual-lino-2016@regulated", file, "--stroke-rate", "1000/min", "--faults", faults]
    how += ["--cylinder-pressure", "0.5MPa", "--return-pressure", "0.1MPa"]
    done = command("diagnose", *how, "--report", report, "--json")
    assert done.status == 0, done.err
    assert done.record["verdict"] == "sound"
    assert len(done.record["tests"]) == 4
    page, said = report.read_text(encoding="utf-8"), command("diagnose", *how).out
    assert "sound parts" in page
    assert "SYNTHETIC part" in page
    assert "SYNTHETIC part" in said
    assert len(said.splitlines()) <= 22
    share = command("diagnose", *how, "--sound", "80")
    assert share.status == 2
    assert "80%" in share.sentence
    file.write_text("\n".join([HEAD, rows[0]]), encoding="utf-8")
    refused = command("diagnose", *how)
    assert refused.status == 2
    assert "1 of 1" in refused.sentence
