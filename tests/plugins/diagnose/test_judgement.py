"""Judgement of a part: its three results are those of plan, diagnose and trim, on one page."""

from __future__ import annotations

import inspect
from dataclasses import replace
from pathlib import Path

import click
import numpy as np
import pytest

import commonrail as cr
from commonrail.base.choices import Drive
from commonrail.base.errors import InputError
from commonrail.cli.console import SIMULATING
from commonrail.cli.grammar import cli
from commonrail.engine.operating_point import Energising
from commonrail.physics.injector import Injector
from commonrail.plugins.diagnose.faults import FaultTable, load_shipped_faults
from commonrail.plugins.diagnose.page import _FAILS, diagnosis_tables, judgement_html, judgement_lines
from commonrail.plugins.diagnose.run import FAILS
from commonrail.plugins.plans.study import Measure, PlanTest, TestPlan
from commonrail.plugins.plans.verb import BenchOptions, _read_part
from tests.cli.conftest import Command

SPRING = "weak valve spring"
INSIDE_SCATTER = _FAILS[True]
TESTS = (("VL", 160, 700), ("EM", 80, 500), ("VE", 80, 350))


@pytest.fixture(scope="module")
def injector() -> Injector:
    drawn = cr.load_injector("virtual-lino-2016")
    return replace(drawn, variant=drawn.variant._replace(drive=Drive.REGULATED))


@pytest.fixture(scope="module")
def table() -> FaultTable:
    faults = tuple(fault for fault in load_shipped_faults().faults if fault.name in (SPRING, "coked nozzle"))
    return FaultTable(faults, load_shipped_faults().scatter)


def results(injector: Injector, *shares: float, band: float = 0.1) -> TestPlan:
    """Tests whose nominal quantities are the injector's, and a part that delivers shares of them."""
    tests = [PlanTest(name, p * 1e6, (Energising(0.0, t * 1e-6),), upper=1.0) for name, p, t in TESTS]
    drawn = cr.parts.plan(injector, TestPlan("plan", tuple(tests)), threads=1).score.values.tolist()
    rows = zip(tests, drawn, shares, strict=True)
    return TestPlan(
        "plan",
        tuple(
            replace(t, nominal=q, lower=(1.0 - band) * q, upper=(1.0 + band) * q, bench=share * q)
            for t, q, share in rows
        ),
    )


def test_the_three_results_are_those_of_plan_diagnose_and_trim(injector: Injector, table: FaultTable) -> None:
    plan = results(injector, 1.12, 1.25, 1.35)
    judged = cr.parts.judge(injector, plan, faults=table, nominal=True, threads=1)
    diagnosis = cr.parts.diagnose(injector, plan, faults=table, nominal=True, threads=1)
    assert judged.diagnosis.probabilities == diagnosis.probabilities
    assert judged.trim is not None
    same = cr.parts.trim(injector, plan, faults=table, nominal=True, noise="workshop", threads=1)
    assert judged.trim.code == same.code
    record = judged.record()
    assert record["verdict"] == record["plan"]["verdict"] == "fail"
    lines, page = judgement_lines(judged), judgement_html(judged, "commonrail judge")
    assert lines[0].startswith("FAIL. ")
    places = [page.index(text) for text in (">FAIL<", SPRING, same.code, "Tolerance fields", "Probabilities<")]
    assert places == sorted(places)
    sound = cr.parts.judge(injector, results(injector, 1.0, 1.0, 1.0), faults=table, threads=1)
    assert sound.record()["verdict"] == "pass"


def test_a_failure_within_makers_scatter_is_said_so(injector: Injector, table: FaultTable) -> None:
    """A band of 2 % is narrower than the scatter of sound parts on a workshop's bench; 40 % are not within it."""
    plan = results(injector, 1.03, 1.0, 1.4, band=0.02)
    diagnosis = cr.parts.diagnose(injector, plan, faults=table, threads=1)
    assert [test.usual for test in diagnosis.tests] == [True, True, False]
    shown = [" ".join(cell.plain for cell in row) for row in diagnosis_tables(diagnosis)[0].rows]
    assert [FAILS in row for row in shown] == [True, False, True]
    assert [INSIDE_SCATTER in row for row in shown] == [True, False, False]


def test_a_part_that_cannot_be_trimmed_is_judged_all_the_same(injector: Injector, table: FaultTable) -> None:
    plan = results(injector, 1.0, 1.0, 1.0)
    returns = tuple(replace(t, measure=Measure.RETURN, stroke_rate=20.0, bench=t.nominal) for t in plan.tests[1:])
    judged = cr.parts.judge(injector, replace(plan, tests=(plan.tests[0], *returns)), faults=table, threads=1)
    assert judged.trim is judged.record()["trim"] is None
    assert judged.reason
    assert judged.reason in " ".join(judgement_lines(judged))
    assert "<h2>Trim</h2>" not in judgement_html(judged, "")


def test_the_verb_reads_a_german_table_and_writes_one_page(
    command: Command, tmp_path: Path, injector: Injector
) -> None:
    file, report = tmp_path / "results.csv", tmp_path / "page.html"
    rows = [
        ";".join([t.name, f"{t.rail_pressure / 1e5:g}", f"{t.energisings[0].duration * 1e6:g}"])
        + "".join(f";{1e9 * (q or 0.0):.4f}" for q in (t.nominal, 0.1 * (t.nominal or 0.0), t.bench)).replace(".", ",")
        for t in results(injector, 1.12, 1.25, 1.35).tests
    ]
    head = "test;rail_pressure [bar];energising_time [µs];nominal [mm³/Hub];half_band [mm³/Hub];bench [mm³/Hub]"
    file.write_bytes("\n".join([head, *rows, ""]).encode("cp1252"))
    done = command("judge", "virtual-lino-2016@regulated", file, "--nominal", "--report", report, "--json")
    assert done.status == 0, done.err
    assert done.record["verdict"] == "fail"
    assert np.argmax([d["probability"] for d in done.record["diagnosis"]["diagnoses"]]) == 0
    assert report.read_text(encoding="utf-8").count("<h2>") == 4  # tests, diagnosis, trim, how to repeat it
    refused = command("judge", "virtual-lino-2016@regulated", file, "--noise", "garage")
    assert (refused.status, "garage" in refused.sentence) == (2, True)


@pytest.mark.parametrize(
    ("verb", "option", "words"),
    [
        ("diagnose", "--noise=-2%", "--noise must lie between"),
        ("diagnose", "--sound=150%", "--sound must lie between 0 and 100 %, both excluded, such as 50%, not 150%"),
        ("diagnose", "--stroke-rate=0/min", "--stroke-rate must lie between"),
        ("diagnose", "--faults=nope.toml", "nope.toml"),
        ("judge", "--step=0us", "--step must lie between"),
        ("trim", "--step=0us", "--step must lie between"),
        ("plan", "--time-step=0us", "time step must lie between"),
    ],
)
def test_an_option_is_refused_before_the_simulation(command: Command, verb: str, option: str, words: str) -> None:
    plan = Path(__file__).parents[3] / "examples" / "test-plan" / "results.csv"
    done = command(verb, "virtual-lino-2016@regulated", plan, option)
    assert done.status == 2
    assert words in done.sentence
    assert SIMULATING not in done.err


def test_a_part_number_leads_to_its_type_and_an_unnamed_one_to_the_nearest() -> None:
    with pytest.warns(RuntimeWarning, match="cri2-0"):
        assert _read_part("0 445 110 343").injector.name == "cri2-0"
    with pytest.raises(InputError, match=r"0445110183.*0445110191"):
        _read_part("0445110183")
    with pytest.raises(InputError):
        _read_part("0950005550")


def test_plan_diagnose_trim_and_judge_have_the_same_options_of_part_and_bench() -> None:
    shared = [*inspect.signature(BenchOptions).parameters]
    for name in ("plan", "diagnose", "trim", "judge"):
        verb = cli.get_command(click.Context(cli), name)
        assert verb is not None
        assert [param.name for param in verb.params if param.name in shared] == shared
