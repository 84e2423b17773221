"""commonrail simulate."""

from __future__ import annotations

import csv
import re
from dataclasses import replace
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

import commonrail as cr
from commonrail.engine.status import Status
from tests.cli.conftest import Command

POINT = ("--rail-pressure", "160MPa", "--energising-time", "700us")
SIMULATE = ("simulate", "virtual-lino-2016", *POINT)


def solution(**changes: float) -> cr.Solution:
    """The same injection by the library."""
    injector = cr.load_injector("virtual-lino-2016").with_values(changes)
    return cr.simulate(injector, cr.OperatingPoint(160e6, 700e-6))


def test_the_record_holds_the_figures_of_the_library(command: Command) -> None:
    record = command(*SIMULATE, "--json").record
    own = solution()
    assert record["status"] == "OK"
    assert record["injected_volume"] == own.injected_volume
    assert record["returned_mass"] == own.returned_mass
    assert record["peak_rate"] == max(own.rate)
    assert record["closing_delay"] == own.closing - 700e-6
    assert record["operating_point"]["rail_pressure"] == 160e6


def test_the_table_is_for_a_person(command: Command) -> None:
    done = command(*SIMULATE)
    assert done.status == 0
    assert f"{solution().injected_volume * 1e9:.2f} mm³" in done.out
    assert Status.OK.name in done.out
    assert "synthetic" in done.out  # the injector of the catalogue says so
    assert "simulating" in done.err


def test_a_parameter_can_be_changed(command: Command) -> None:
    record = command(*SIMULATE, "--set", "plunger_needle.k1=303N/um", "--json").record
    own = solution(**{"plunger_needle.k1": 3.03e8})
    assert record["injected_volume"] == own.injected_volume


def test_the_body_can_be_rigid(command: Command) -> None:
    record = command("simulate", "virtual-lino-2016@rigid", *POINT, "--json").record
    assert record["injector"]["variant"].startswith("rigid body")
    assert record["injected_volume"] < 0.9 * solution().injected_volume


def test_a_pilot_and_a_main_injection_inject_more_than_the_main_one(command: Command) -> None:
    pulses = ("--energising", "0us:250us", "--energising", "900us:700us")
    rail = ("--rail-pressure", "160MPa")
    record = command("simulate", "virtual-lino-2016", *rail, *pulses, "--json").record
    assert len(record["operating_point"]["energisings"]) == 2
    assert record["injected_volume"] > solution().injected_volume
    assert record["closing_delay"] == pytest.approx(record["closing"] - 1600e-6)


def test_no_injection_has_no_opening(command: Command) -> None:
    rail = ("--rail-pressure", "160MPa", "--energising-time", "0us")
    record = command("simulate", "virtual-lino-2016", *rail, "--json").record
    assert record["opening"] is None
    assert record["closing_delay"] is None
    assert "never" in command("simulate", "virtual-lino-2016", *rail).out


def test_the_csv_has_units_and_adds_up(command: Command, tmp_path: Path) -> None:
    path = tmp_path / "course.csv"
    record = command(*SIMULATE, "--json", "--out", path).record
    assert record["files"] == [str(path)]
    lines = path.read_text(encoding="utf-8").splitlines()
    assert lines[0].startswith("# simulated by commonrail, not measured")
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    volume = sum(float(row["rate [mm3/ms]"]) for row in rows) * 1e-3  # mm3/ms times 1 us
    # nine digits a row
    assert volume == pytest.approx(record["injected_volume"] * 1e9, rel=1e-8)
    assert float(rows[-1]["injected [mg]"]) == pytest.approx(record["injected_mass"] * 1e6)
    assert all("[" in name for name in rows[0])


def test_the_csv_can_be_read_back_as_data(command: Command, tmp_path: Path) -> None:
    from commonrail.readers.columns import Column
    from commonrail.readers.tables import read_columns

    path = tmp_path / "course.csv"
    command(*SIMULATE, "--out", path)
    columns = read_columns(path, [Column("time", "s", increasing=True), Column("rate", "m3/s")]).columns
    assert columns["time"][0] == pytest.approx(1e-6)
    assert max(columns["rate"]) == pytest.approx(max(solution().rate))


def test_the_plot_is_a_page(command: Command, tmp_path: Path) -> None:
    path = tmp_path / "course.html"
    done = command(*SIMULATE, "--report", path)
    assert path.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    assert f"wrote {path}" in done.err


def test_a_needle_that_is_still_open_is_told_and_figures_are_given(command: Command) -> None:
    done = command(*SIMULATE, "--horizon", "500us", "--json")
    assert done.status == 0
    assert done.record["status"] == "STILL_INJECTING"
    assert done.record["closing"] is None
    assert done.sentence == Status.STILL_INJECTING.sentence


def test_a_failed_simulation_ends_with_4_and_says_what_to_do(
    command: Command, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    failed = replace(solution(), status=Status.STEP_UNSTABLE, find_longest_step=lambda: 2.2e-6)
    monkeypatch.setattr("commonrail.engine.simulate.simulate", lambda *_, **__: failed)
    done = command(*SIMULATE, "--json", "--out", tmp_path / "x.csv")
    assert (done.status, done.out) == (4, "")
    assert done.sentence == f"virtual-lino-2016: {Status.STEP_UNSTABLE.sentence} A step of 2 us would do."
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("simulate", "nothing", *POINT), "or injector"),
        (("simulate", "direct-acting-kr@flexible", *POINT), "rigid body"),
        ((*SIMULATE, "--set", "rail.volume=20cm3"), 'rail_boundary = "v'),
        (("simulate", "nothing.toml", *POINT), "nothing.toml"),
        ((*SIMULATE, "--cylinder-pressure", "5"), "--cylinder-pressure: "),
        ((*SIMULATE, "--return-pressure", "0MPa"), "return pressure"),
        ((*SIMULATE, "--horizon", "0us"), "The horizon"),
        ((*SIMULATE, "--time-step", "1ms"), "The time step"),
        ((*SIMULATE, "--energising", "0us:1us"), "one injection"),
        ((*SIMULATE, "--out", "/nowhere/x.csv"), "/nowhere;"),
        ((*SIMULATE, "--out", "x.xyz"), ".csv, .foam, .dat"),
        ((*SIMULATE, "--out", "x.foam.txt"), ".csv, .foam, .dat"),
        ((*SIMULATE, "--report", "."), "--report: . "),
        ((*SIMULATE, "--set", "a.b=1"), "such parameter"),
        # of a direct-acting injector
        ((*SIMULATE, "--set", "armature.mass=1g"), "`commonrail catalogue parameters`"),
        (
            (*SIMULATE, "--engine", "reference", "--precision", "f32"),
            "--precision f32: ",
        ),
        (
            (*SIMULATE, "--engine", "reference", "--time-step", "1us"),
            "--time-step: the reference",
        ),
    ],
)
def test_bad_input_ends_with_2_and_one_sentence(command: Command, arguments: tuple[str, ...], words: str) -> None:
    done = command(*arguments)
    assert (done.status, done.out) == (2, "")
    assert words in done.sentence


def test_a_step_that_is_too_long_names_one_that_would_do(command: Command) -> None:
    base = ("simulate", "virtual-lino-2016", "--rail-pressure", "160MPa", "--energising-time", "700us")
    done = command(*base, "--time-step", "3us")
    assert done.status == 4
    assert done.sentence.endswith("A step of 2 us would do.")


def test_single_precision_can_be_asked(command: Command) -> None:
    record, own = command(*SIMULATE, "--precision", "f32", "--json").record, solution()
    assert record["precision"] == "f32"
    assert record["injected_volume"] != own.injected_volume
    # 1.3e-5 was the most seen at any pressure: sums of some 2000 numbers of single precision
    assert record["injected_volume"] == pytest.approx(own.injected_volume, rel=1e-4)
    assert "lanes, f32" in command(*SIMULATE, "--precision", "f32", "--full").out


@pytest.mark.slow
def test_the_reference_can_be_asked(command: Command) -> None:
    record = command(*SIMULATE, "--engine", "reference", "--json").record
    assert record["engine"] == "reference"
    assert record["time_step"] is None
    # the engines agree to a fraction of a percent; a wrong point or injector would not
    assert record["injected_volume"] == pytest.approx(solution().injected_volume, rel=5e-3)


def test_an_absurd_value_fails_as_a_simulation_and_not_as_a_fault(command: Command) -> None:
    line = ("simulate", "cri2-16", "--rail-pressure", "80MPa", "--energising-time", "500us")
    done = command(*line, "--set", "nozzle.holes=1e308")
    assert done.status == 4, done.err


def test_a_set_value_that_no_injector_has_is_told(command: Command) -> None:
    usual = command(*SIMULATE, "--set", "valve.mass=6g")
    assert "is usual" not in usual.err
    odd = command(*SIMULATE, "--set", "valve.mass=6kg")  # 6 g meant
    assert re.search(r"--set valve\.mass: .*\b6 kg, .*100 mg to 100 g", odd.err)


def test_an_engine_that_is_not_to_be_had_is_refused(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("commonrail.engine.cuda.missing", lambda: 'The engine "cuda" needs a GPU.')
    done = command(*SIMULATE, "--engine", "cuda")
    assert done.status == 2
    assert done.err.endswith('commonrail: The engine "cuda" needs a GPU.\n')
    assert "Traceback" not in done.err


METERS = """
[meters.bench]
delay = { lower = "0 us", upper = "40 us", start = "20 us" }
gain = 1.5
"""


def metered_study(tmp_path: Path) -> Path:
    """The scaffold's study with a meter; its data are not there, and need not be."""
    text = resources.files("commonrail.plugins.new").joinpath("template", "study.toml").read_text(encoding="utf-8")
    file = tmp_path / "study.toml"
    file.write_text(text + METERS, encoding="utf-8")
    return file


def test_a_meter_shows_its_rate_beside_the_true_one(command: Command, tmp_path: Path) -> None:
    files = ("--study", str(metered_study(tmp_path)), "--meter", "bench")
    out, plot = tmp_path / "seen.csv", tmp_path / "seen.html"
    record = command(*SIMULATE, *files, "--out", str(out), "--report", str(plot), "--json").record
    own = solution()
    assert record["meter"]["name"] == "bench"
    assert record["meter"]["quantity"] == pytest.approx(1.5 * own.injected_volume)
    rows = list(csv.DictReader(line for line in out.read_text(encoding="utf-8").splitlines() if line[0] != "#"))
    true, seen = (
        np.array([float(row[key]) for row in rows]) for key in ("rate [mm3/ms]", "rate by meter bench [mm3/ms]")
    )
    # nine digits in the file; the delay is twenty steps
    np.testing.assert_allclose(seen[20:], 1.5 * true[:-20], atol=1e-6)
    assert "meter bench" in plot.read_text(encoding="utf-8")
    assert "meter bench" in command(*SIMULATE, *files).out


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--meter", "bench"), "no meters"),
        (("--study", "STUDY"), "with --meter"),
        (("--study", "STUDY", "--meter", "bank"), 'meter "bank"'),
    ],
)
def test_a_meter_that_is_not_there_is_one_sentence(
    command: Command, tmp_path: Path, options: tuple[str, ...], words: str
) -> None:
    file = str(metered_study(tmp_path))
    done = command(*SIMULATE, *(file if option == "STUDY" else option for option in options))
    assert done.status == 2
    assert words in " ".join(done.err.split())
    assert "Traceback" not in done.err
