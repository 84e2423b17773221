"""Test plans: bands and distances by hand, reading, a model on its own plan, and the verdict on a part."""

from __future__ import annotations

import math
import re
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from commonrail.base.choices import Drive
from commonrail.base.errors import CommonrailError, ConfigurationError, SimulationError
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.simulate import simulate
from commonrail.engine.status import Status
from commonrail.physics.injector import Injector
from commonrail.plugins.plans.data import PlanData
from commonrail.plugins.plans.run import plan as run_plan
from commonrail.plugins.plans.study import Bands, Measure, PlanTest, State, TestPlan, load_plan, without_rate
from commonrail.readers.injector import load_injector
from tests.cli.conftest import Command
from tests.data.samples import Sample, plan_table

PULSE = ((0.0, 500e-6),)
PRESSURES = (5e6, 0.5e6)
HEAD = "test,rail_pressure [MPa],energising_time [us]"


def band(**limits: float) -> PlanTest:
    """A test with quantities in mm³."""
    return PlanTest("VL", 80e6, PULSE, **{key: 1e-9 * value for key, value in limits.items()})


def plan_file(folder: Path, text: str) -> Path:
    file = folder / "plan.csv"
    file.write_text(text, encoding="utf-8")
    return file


@pytest.fixture
def direct() -> Injector:
    """A direct-acting injector with a drive of its own."""
    injector = load_injector("direct-acting-kr")
    return replace(injector, variant=injector.variant._replace(drive=Drive.REGULATED))


@pytest.mark.parametrize(
    ("limits", "value", "distance", "excess", "state"),
    [
        ({"nominal": 60, "lower": 55, "upper": 70}, 54, -1.2, -1.2, State.BELOW),
        ({"nominal": 60, "lower": 55, "upper": 70}, 65, 0.5, 0.5, State.INSIDE),
        ({"nominal": 60, "lower": 55, "upper": 70}, 0.5, -11.9, -11.9, State.NO_INJECTION),
        ({"lower": 20, "upper": 60}, 50, 0.5, 0.5, State.INSIDE),  # the middle is 40
        ({"upper": 60}, 66, 1.1, 0.1, State.ABOVE),  # distances count from zero
        ({"upper": 60}, 15, 0.25, 0.0, State.INSIDE),
        ({"nominal": 40, "lower": 30}, 25, -1.5, -0.5, State.BELOW),
        ({"nominal": 40, "lower": 30}, 90, 5.0, 0.0, State.INSIDE),
    ],
)
def test_distances_in_half_bands_are_those_by_hand(
    limits: dict[str, float], value: float, distance: float, excess: float, state: State
) -> None:
    test = band(**limits)
    bands, values = Bands.of([test]), np.array([1e-9 * value])
    assert bands.distance(values)[0] == pytest.approx(distance, rel=1e-12)
    assert bands.excess(values)[0] == pytest.approx(excess, rel=1e-12)
    assert test.state(float(values[0])) is state
    data = PlanData.of(TestPlan("plan", (test,)), load_injector("virtual-lino-2016"), PRESSURES, "plan")
    error = math.sqrt(6.0) * excess  # a triangular distribution about the middle
    assert data.errors(values)[0] == pytest.approx(error, rel=1e-12)
    assert data.misfit(values) == pytest.approx(2.0 * (math.sqrt(1.0 + error**2) - 1.0), rel=1e-9, abs=1e-15)


def test_bands_of_a_file_in_percent_and_in_quantities(tmp_path: Path) -> None:
    head = f"{HEAD},measure,second_energising_time [us],dwell [ms],nominal [mm3],half_band [%]"
    plan = load_plan(
        plan_file(
            tmp_path,
            f"{head},lower_limit [mm3],upper_limit [%],stroke_rate [1/min],bench [mm3]\n"
            "VL,135,800,,,,50,10,,,,48\n"
            "VE+HE,80,200,delivery,500,0.9,20,,15,110,,\n"
            "back flow,1.2e2,0,return,,,40,,,150,600,\n",
        )
    )
    first, second, third = plan.tests
    assert (first.lower, first.upper, first.bench) == pytest.approx((45e-9, 55e-9, 48e-9))
    assert (second.lower, second.upper) == pytest.approx((15e-9, 22e-9))
    assert [x for pulse in second.energisings for x in pulse] == pytest.approx([0.0, 200e-6, 1.1e-3, 500e-6])
    assert (third.lower, third.measure, third.stroke_rate) == (None, Measure.RETURN, pytest.approx(10.0))
    assert third.upper == pytest.approx(60e-9)
    assert first.band == "50 ± 5"
    assert second.band == "20 −5 +2"
    assert third.band == "40, ≤ 60"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (f"{HEAD},nominal [mm3]\nVL,80,500,20\n", ("line 2", "VL", "half_band")),
        (f"{HEAD},lower_limit [mm3]\nVL,80,500,20\n", ("line 2", "lower_limit", "nominal")),
        (f"{HEAD},half_band [%]\nVL,80,500,20\n", ("line 2", "nominal")),
        (f"{HEAD},upper_limit [%]\nVL,80,500,20\n", ("line 2", "nominal")),
        (f"{HEAD},lower_limit [mm3],upper_limit [mm3]\nVL,80,500,20,10\n", ("line 2", "lower limit", "VL")),
        (f"{HEAD},nominal [mm3],half_band [%],upper_limit [mm3]\nVL,80,500,20,10,30\n", ("line 2", "half_band")),
        (f"{HEAD},upper_limit [bar]\nVL,80,500,20\n", ('column "upper_limit"', "bar")),
        (f"{HEAD},upper_limit [mm3]\nVL,80,much,20\n", ("line 2", 'column "energising_time"', "much")),
        (f"{HEAD},upper_limit [mm3]\nVL,80,0,20\n", ("line 2", "energising time")),
        (f"{HEAD},upper_limit [mm3]\nVL,80e6,500,20\n", ("line 2", "rail pressure")),
        (f"{HEAD},upper_limit [mm3]\n,80,500,20\n", ("line 2", 'column "test"')),
        (f"{HEAD},upper_limit [mm3],measure\nVL,80,500,20,back\n", ("line 2", 'column "measure"', "back")),
        (f"{HEAD},upper_limit [mm3],dwell [us]\nVL,80,500,20,900\n", ("line 2", "second_energising_time")),
        (f"{HEAD},upper_limit [mm3],nominal [mg]\nVL,80,500,20,10\n", ('column "upper_limit"',)),
        (f"{HEAD},upper_limit [mm3]\nVL,80,500,20\nVL,60,500,20\n", ("VL", "delivery")),
        (f"{HEAD},nominal [mm3],half_band [%]\nVL,80,500,20,100\n", ("line 2", "half_band", "100 %")),
        (f"{HEAD},upper_limit [mm3],bench [mm3]\nVL,80,500,20,nan\n", ("line 2", 'column "bench"')),
        (f"{HEAD},nominal [mm3],half_band\nVL,80,500,20,10\n", ("half_band [%]",)),
        ("test,rail_pressure [MPa]\nVL,80\n", ("energising_time",)),
    ],
)
def test_a_senseless_plan_is_refused_with_its_place(text: str, words: tuple[str, ...], tmp_path: Path) -> None:
    with pytest.raises(CommonrailError) as caught:
        load_plan(plan_file(tmp_path, text))
    assert all(word in str(caught.value) for word in ("plan.csv", *words)), str(caught.value)


def test_a_column_that_is_not_read_is_named(tmp_path: Path) -> None:
    with pytest.warns(RuntimeWarning, match='"uper_limit".*"upper_limit"'):
        load_plan(plan_file(tmp_path, f"{HEAD},upper_limit [mm3],uper_limit [mm3]\nVL,160,700,90,3\n"))


def test_a_stroke_rate_of_no_engine_is_warned_of(tmp_path: Path) -> None:
    with pytest.warns(RuntimeWarning, match='line 2, column "stroke_rate"'):
        load_plan(plan_file(tmp_path, f"{HEAD},upper_limit [mm3],stroke_rate [1/s]\nVL,160,700,90,1000\n"))


def unit_warnings(folder: Path, units: tuple[str, str, str], rows: str) -> list[str]:
    """Warnings of a plan whose pressures, times and limits have these units."""
    pressure, time, limit = units
    head = f"test,rail_pressure [{pressure}],energising_time [{time}],upper_limit [{limit}],measure"
    with warnings.catch_warnings(record=True) as notes:
        warnings.simplefilter("always")
        load_plan(plan_file(folder, f"{head}\n{rows}"))
    return [str(one.message) for one in notes]


def test_a_usual_plan_has_no_warning(tmp_path: Path) -> None:
    assert unit_warnings(tmp_path, ("bar", "us", "mm3"), "leak,2500,0,20,return\nVE,10,50,2000,\n") == []


@pytest.mark.parametrize(
    ("units", "row", "words"),
    [
        (("bar", "us", "mm3"), "5,700,90", ("rail_pressure", "500 kPa", "1 MPa to 400 MPa")),
        (("MPa", "us", "mm3"), "500,700,90", ("rail_pressure", "500 MPa", "1 MPa to 400 MPa")),
        (("MPa", "ms", "mm3"), "160,70,90", ("energising_time", "70 ms", "50 us to 10 ms")),
        (("MPa", "us", "mm3"), "160,0.7,90", ("energising_time", "700 ns", "50 us to 10 ms")),
        (("MPa", "us", "cm3"), "160,700,90", ("upper_limit", "2 cm3")),
        (("MPa", "us", "g"), "160,700,90", ("upper_limit", "2 g")),
    ],
)
def test_a_number_that_a_wrong_unit_makes_is_warned_of_with_its_place(
    units: tuple[str, str, str], row: str, words: tuple[str, ...], tmp_path: Path
) -> None:
    (text,) = unit_warnings(tmp_path, units, f"VL,{row},\n")
    assert all(word in text for word in ("plan.csv, line 2", *words)), text


TESTS = (
    PlanTest("VL", 160e6, ((0.0, 700e-6),), 1e-9, 0.0, 2e-9),
    PlanTest("VE+HE", 60e6, ((0.0, 300e-6), (1.2e-3, 500e-6)), 1e-9, 0.0, 2e-9),
    PlanTest("back flow", 160e6, ((0.0, 700e-6),), 1e-9, 0.0, 2e-9, Measure.RETURN, 1000.0 / 60.0),
)


ENGINE = {"cylinder_pressure": 5e6, "return_pressure": 0.5e6}  # those of an `OperatingPoint` that states none


def simulated(injector: Injector, *tests: PlanTest) -> np.ndarray:
    return run_plan(injector, TestPlan("plan", tests), **ENGINE, threads=1).score.values


def test_quantities_are_those_of_single_simulations_and_of_a_closed_injector(regulated: Injector) -> None:
    values = simulated(regulated, *TESTS)
    for value, test in zip(values[:2], TESTS, strict=False):
        solution = simulate(regulated, OperatingPoint(test.rail_pressure, test.energisings, horizon=5e-3))
        # a batch adds up the same steps in another order
        assert value == pytest.approx(solution.injected_volume, rel=1e-9)
    closed, short = (OperatingPoint(160e6, time, horizon=8e-3) for time in (0.0, 700e-6))
    leak = simulate(regulated, closed).returned_mass / 8e-3
    density = regulated.fuel.density(np.array([0.5e6]), regulated.values["fuel.temperature"])[0]
    stroke = (simulate(regulated, short).returned_mass + leak * (60e-3 - 8e-3)) / density
    # the closed injector of the simulation starts at rest, the one after a stroke has it reached but for 0.1 %
    assert values[2] == pytest.approx(stroke, rel=2e-3)
    assert (
        values[2]
        > 1.02 * simulated(regulated, PlanTest("x", 160e6, TESTS[2].energisings, upper=1.0, measure=Measure.RETURN))[0]
    )


def test_a_model_passes_its_own_plan_and_fails_one_that_lies_two_half_bands_off(regulated: Injector) -> None:
    values = simulated(regulated, *TESTS)

    def plan(shift: float) -> TestPlan:
        half = 0.1 * values
        rows = zip(TESTS, values + shift * half, half, strict=True)
        return TestPlan(
            "plan",
            tuple(
                PlanTest(t.name, t.rail_pressure, t.energisings, m, m - h, m + h, t.measure, t.stroke_rate)
                for t, m, h in rows
            ),
        )

    own, above = (run_plan(regulated, plan(shift), **ENGINE, threads=1) for shift in (0.0, -2.0))
    assert own.score.states == [State.INSIDE] * 3
    assert own.distances == pytest.approx(np.zeros(3), abs=1e-9)
    assert above.score.states == [State.ABOVE] * 3
    assert above.distances == pytest.approx(2.0 * np.ones(3))
    assert above.score.error == pytest.approx(2.0)


def test_a_plan_in_masses_is_judged_as_one_in_volumes(regulated: Injector, tmp_path: Path) -> None:
    rows = "VL,160,700,40,10,\nback flow,160,700,20,10,return\n"
    head = f"{HEAD},nominal [mg],half_band [%],measure\n"
    result = run_plan(regulated, load_plan(plan_file(tmp_path, head + rows)), **ENGINE, threads=1)
    batch = simulate(regulated, OperatingPoint(160e6, 700e-6, horizon=3.7e-3))
    masses = np.array([batch.injected_mass, batch.returned_mass])
    assert result.distances == pytest.approx((masses / [40e-6, 20e-6] - 1.0) / 0.1, rel=1e-6)


def test_without_pressures_a_plan_is_run_on_a_bench_and_not_in_an_engine(
    command: Command, regulated: Injector, tmp_path: Path
) -> None:
    """At 30 MPa 5 MPa behind the nozzle slow the jet by 1 − √(25/29.5) = 8 %."""
    file = plan_file(tmp_path, f"{HEAD},nominal [mm3],half_band [%]\nLL,30,900,10,50\n")
    (row,) = run_plan(regulated, file, threads=1).record()["data"]["rows"]
    (by_command,) = command("plan", "virtual-lino-2016@regulated", file, "--json").record["data"]["rows"]
    for found in (row, by_command):
        assert (found["cylinder_pressure"], found["return_pressure"]) == (0.5e6, 0.1e6)
    in_engine = run_plan(regulated, file, **ENGINE, threads=1)
    assert in_engine.score.values[0] < row["simulated"]


def test_the_rms_is_that_of_the_distances_with_single_limits_by_their_excess(
    regulated: Injector, tmp_path: Path
) -> None:
    head = f"{HEAD},nominal [mm3],half_band [%],upper_limit [mm3]"
    rows = "VL,160,700,50,10,\ninside,160,700,,,90\noutside,160,700,,,20\n"
    data = run_plan(regulated, plan_file(tmp_path, f"{head}\n{rows}"), threads=1).record()["data"]
    two_sided, inside, outside = (row["found"]["simulated"]["distance"] for row in data["rows"])
    assert 0.0 < inside < 1.0 < outside
    assert data["rms"]["simulated"] == pytest.approx(np.sqrt((two_sided**2 + (outside - 1.0) ** 2) / 3.0))


def test_some_tests_of_a_plan_are_chosen_by_name() -> None:
    plan = TestPlan("plan", TESTS)
    assert [t.name for t in plan.select(["back flow", "VL"]).tests] == ["VL", "back flow"]
    with pytest.raises(ConfigurationError, match="VX"):
        plan.select(["VX"])


def test_a_plan_that_does_not_suit_the_injector_is_refused(direct: Injector, by_voltage: Injector) -> None:
    for injector, measure, words in (
        (direct, "return", "test b: .*return"),
        (by_voltage, "delivery", "voltage trace"),
    ):
        with pytest.raises(ConfigurationError, match=words):
            run_plan(injector, TestPlan("plan", (PlanTest("b", 20e6, PULSE, upper=1.0, measure=measure),)))


def test_a_stroke_that_is_shorter_than_the_injection_is_refused(regulated: Injector) -> None:
    fast = PlanTest("b", 80e6, PULSE, upper=1.0, measure=Measure.RETURN, stroke_rate=500.0)
    with pytest.raises(ConfigurationError, match="stroke"):
        run_plan(regulated, TestPlan("plan", (fast,)))


@pytest.mark.parametrize(
    ("bench", "word"), [(("48", "22"), "pass"), (("48", ""), "open"), (("56", ""), "fail"), (("56", "22"), "fail")]
)
def test_the_part_on_the_bench_is_judged(
    bench: tuple[str, str], word: str, tmp_path: Path, regulated: Injector
) -> None:
    head = f"{HEAD},nominal [mm3],half_band [%],bench [mm3]"
    file = plan_file(tmp_path, f"{head}\nVL,160,700,50,10,{bench[0]}\nEM,100,400,20,20,{bench[1]}\n")
    result = run_plan(regulated, file, threads=1)
    assert result.judged.verdict == result.record()["verdict"] == word


def test_a_test_that_fails_has_a_reason_and_the_others_a_number(regulated: Injector) -> None:
    # a spring that holds the valve at 60 MPa and not at 160
    weak = regulated.with_values({"valve.spring_preload": 0.3 * regulated.values["valve.spring_preload"]})
    result = run_plan(weak, TestPlan("plan", TESTS[:2]), threads=1)
    assert [state is State.FAILED for state in result.score.states] == [True, False]
    assert result.reasons[0] == Status.NOT_CLOSED_AT_START.sentence
    assert result.reasons[1] == ""
    with pytest.raises(SimulationError, match=re.escape(Status.NOT_CLOSED_AT_START.sentence)):
        run_plan(weak, TestPlan("plan", TESTS[:1]), threads=1)


@pytest.mark.parametrize(
    ("pressure", "quantity", "words"),
    [(0.1, 1.0, "rail pressures"), (1.0, 1e3, " 1000 "), (1.0, 1e-3 * 0.83, " 0.00083 "), (1.0, 1.5, "")],
)
def test_a_wrong_unit_that_explains_all_deliveries_is_named(
    pressure: float, quantity: float, words: str, regulated: Injector
) -> None:
    values = simulated(regulated, *TESTS[:2])
    rows = [
        PlanTest(test.name, pressure * test.rail_pressure, test.energisings, m, 0.9 * m, 1.1 * m)
        for test, m in zip(TESTS[:2], (quantity * values).tolist(), strict=True)
    ]
    found = run_plan(regulated, TestPlan("plan", tuple(rows)), **ENGINE, threads=1)
    assert words in found.hint
    assert bool(words) == bool(found.hint)


def test_the_verb_prints_json_and_writes_a_report(command: Command, tmp_path: Path) -> None:
    file = plan_file(
        tmp_path,
        f"# SYNTHETIC plan\n{HEAD},nominal [mm3],half_band [%],measure,bench [mm3]\n"
        "VL,160,700,52,9,,50\nR,160,700,9,50,return,\n",
    )
    report = tmp_path / "plan.html"
    done = command(
        "plan", "virtual-lino-2016@regulated", file, "--stroke-rate", "1000/min", "--report", report, "--json"
    )
    assert done.status == 0, done.err
    rows = done.record["data"]["rows"]
    assert [row["measure"] for row in rows] == ["delivery", "return"]
    assert rows[1]["stroke_rate"] == pytest.approx(1000.0 / 60.0)
    page = report.read_text(encoding="utf-8")
    assert "Synthetic, not" in page
    assert "SYNTHETIC plan" in page
    assert done.record["synthetic"] == "SYNTHETIC plan"
    german = file.read_text(encoding="utf-8").replace(",", ";").replace("52", "52,0")
    file.write_text(german, encoding="utf-8")
    assert command("plan", "virtual-lino-2016@regulated", file, "--decimal", ".").status == 2
    said = command("plan", "virtual-lino-2016@regulated", file)
    assert without_rate(["R (return)"]) in " ".join(said.out.split())


@pytest.mark.parametrize(("keys", "told"), [("", 1), ('stroke_rate = "1000 1/min"\n', 0)])
def test_a_study_tells_of_a_return_without_a_stroke_rate(
    regulated: Injector, tmp_path: Path, keys: str, told: int
) -> None:
    with warnings.catch_warnings(record=True) as notes:
        warnings.simplefilter("always")
        Sample(keys, plan_table, 4).read(PlanData, regulated, tmp_path, np.full(4, 5e-8))
    assert ["test 3 (return)" in str(one.message) for one in notes] == [True] * told


def test_a_synthetic_mark_above_the_head_of_a_workbook_is_carried_on(tmp_path: Path) -> None:
    book = pytest.importorskip("openpyxl", reason="the extra excel is not installed").Workbook()
    for row in (["Synthetisch: simuliert"], [*HEAD.split(","), "upper_limit [mm3]"], ["VL", 160, 700, 57]):
        book.active.append(row)
    book.save(tmp_path / "plan.xlsx")
    assert load_plan(tmp_path / "plan.xlsx").synthetic == "Synthetisch: simuliert"
