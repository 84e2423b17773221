"""Trim: corrections that bring a part back to nominal, its code, and what cannot be trimmed."""

from __future__ import annotations

import json
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from commonrail.base.choices import Drive
from commonrail.base.errors import InputError
from commonrail.engine.operating_point import Energising, OperatingPoint
from commonrail.engine.simulate import simulate_batch
from commonrail.physics.injector import Injector
from commonrail.plugins.diagnose.trim import _reasons, trim
from commonrail.plugins.plans.study import Measure, PlanTest, TestPlan
from commonrail.readers.injector import load_injector
from tests.cli.conftest import Command

TESTS = (("LL", 40, 600), ("EM", 80, 500), ("VL", 160, 700))
HEAD = "test,rail_pressure [MPa],energising_time [us],upper_limit [mm3],bench [mm3]"


@pytest.fixture(scope="module")
def injector() -> Injector:
    drawn = load_injector("virtual-lino-2016")
    return replace(drawn, variant=drawn.variant._replace(drive=Drive.REGULATED))


@pytest.fixture(scope="module")
def part(injector: Injector) -> Injector:
    """A part within tolerances: weaker spring, larger A-hole."""
    own = injector.values
    return injector.with_values(
        {
            "valve.spring_preload": 0.97 * own["valve.spring_preload"],
            "control_chamber.a_hole_diameter": 1.02 * own["control_chamber.a_hole_diameter"],
        }
    )


def quantities(injector: Injector, points: list[tuple[float, float]]) -> np.ndarray:
    """Injected volumes at rail pressures [Pa] and energising times [s], not by the code that trims."""
    at = [OperatingPoint(p, t, 0.5e6, 0.1e6, horizon=t + 3e-3) for p, t in points]
    return np.asarray(simulate_batch(injector, at, threads=1).injected_volume[0])


def results(part: Injector) -> TestPlan:
    points = [(p * 1e6, t * 1e-6) for _, p, t in TESTS]
    rows = zip(TESTS, points, quantities(part, points).tolist(), strict=True)
    return TestPlan(
        "plan", tuple(PlanTest(n, p, (Energising(0.0, t),), upper=1.0, bench=q) for (n, *_), (p, t), q in rows)
    )


def test_corrections_bring_a_part_back_between_its_tests(injector: Injector, part: Injector) -> None:
    found = trim(
        injector, results(part), noise=0.002, rail_pressures=[60e6, 120e6], energising_times=[550e-6, 650e-6], threads=1
    )
    at = [(t.rail_pressure, t.energisings[0].duration) for t in found.points]
    assert len(at) == 4
    drawn, before = quantities(injector, at), quantities(part, at)
    after = quantities(part, [(p, t + c) for (p, t), c in zip(at, found.corrections.tolist(), strict=True)])
    assert np.all(np.abs(before / drawn - 1.0) > 0.02)
    assert np.sqrt(np.mean((after / drawn - 1.0) ** 2)) < 0.3 * np.sqrt(np.mean((before / drawn - 1.0) ** 2))
    assert np.all(found.trimming.left < found.trimming.spread)


def test_a_point_at_a_test_has_the_correction_of_its_class(injector: Injector, part: Injector) -> None:
    found = trim(
        injector, results(part), step="1 us", noise=0.001, rail_pressures=[160e6], energising_times=[700e-6], threads=1
    )
    assert found.corrections[0] == pytest.approx(found.classes[2] * 1e-6, rel=0.15)  # it is the most likely, not exact
    assert np.all(found.classes == np.round(found.classes))
    assert found.code.startswith("LL -")


def test_a_sound_part_as_drawn_has_the_code_zero(injector: Injector) -> None:
    found = trim(injector, results(injector), rail_pressures=[60e6], energising_times=[550e-6], threads=1)
    assert found.code == "LL +0, EM +0, VL +0"
    np.testing.assert_array_equal(found.corrections, 0.0)


def test_a_mistyped_result_is_warned_of_by_its_test(injector: Injector, part: Injector) -> None:
    plan = results(part)
    wrong = replace(plan.tests[2], bench=0.1 * (plan.tests[2].bench or 0.0))
    at = {"rail_pressures": [60e6], "energising_times": [550e-6], "threads": 1}
    with pytest.warns(RuntimeWarning, match=r"^plan: VL \(−\d"):
        found = trim(injector, replace(plan, tests=(*plan.tests[:2], wrong)), **at)
    assert np.abs(found.distances[:2]).max() < 3.0 < -found.distances[2]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        trim(injector, plan, **at)


def test_what_cannot_be_trimmed_is_refused(injector: Injector, part: Injector) -> None:
    plan = results(part)
    with pytest.raises(InputError, match=r"only 1 .*\bbench\b"):
        trim(injector, replace(plan, tests=plan.tests[:1]))
    returns = tuple(replace(test, measure=Measure.RETURN) for test in plan.tests)
    with pytest.raises(InputError, match=r"only 0 .*\bbench\b"):
        trim(injector, replace(plan, tests=returns))
    short = replace(plan.tests[0], name="short", energisings=(Energising(0.0, 30e-6),))
    with pytest.raises(InputError, match=r"\bshort\b"):
        trim(injector, replace(plan, tests=(*plan.tests, short)), threads=1)
    with pytest.raises(InputError, match=r"at 1 "):
        trim(injector, plan, rail_pressures=[80e6], energising_times=[30e-6], threads=1)


def test_points_that_cannot_be_trimmed_are_counted(injector: Injector, part: Injector) -> None:
    with pytest.warns(RuntimeWarning, match=r"^1 of 2 .* at 1 "):
        found = trim(injector, results(part), rail_pressures=[80e6], energising_times=[30e-6, 600e-6], threads=1)
    assert [point.energisings[0].duration for point in found.points] == [600e-6]


def test_a_point_without_a_simulation_asks_for_no_longer_time() -> None:
    text = _reasons(np.array([np.nan, 1.0, 0.0]), np.array([1e-8, 0.0, 1e-8]))
    assert text.count("at 1 ") == 3
    assert text.index("shorter") < text.index("longer")


def test_a_correction_that_leaves_no_time_is_refused(injector: Injector, part: Injector) -> None:
    plan = results(part)
    wrong = replace(plan.tests[2], bench=10.0 * (plan.tests[2].bench or 0.0))
    with pytest.raises(InputError, match=r"VL .*−\d+ µs"):
        trim(injector, replace(plan, tests=(*plan.tests[:2], wrong)), threads=1)


def test_the_verb_writes_corrections(command: Command, tmp_path: Path, part: Injector) -> None:
    file, out = tmp_path / "results.csv", tmp_path / "corrections.csv"
    rows = [
        f"{n},{p},{t},100,{1e9 * (test.bench or 0.0)}"
        for (n, p, t), test in zip(TESTS, results(part).tests, strict=True)
    ]
    file.write_text("\n".join(["# SYNTHETIC part", HEAD, *rows]), encoding="utf-8")
    how = ["virtual-lino-2016@regulated", file, "--rail-pressure", "60,100MPa", "--energising-time", "550us"]
    done = command("trim", *how, "--out", out, "--json")
    assert done.status == 0, done.err
    assert done.record["synthetic"] == "SYNTHETIC part"
    mark, *lines = out.read_text(encoding="utf-8").splitlines()
    assert mark == "# SYNTHETIC part"
    assert lines[0] == "rail_pressure [MPa],energising_time [us],correction [us]"
    written = [float(line.split(",")[2]) for line in lines[1:]]
    assert written == pytest.approx([1e6 * point["correction"] for point in done.record["points"]], abs=1e-3)
    assert json.dumps(done.record["code"])
    refused = command("trim", *how, "--step", "2mm3")
    assert refused.status == 2
    assert "--step" in refused.sentence
