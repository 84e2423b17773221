"""commonrail sensitivity: tables, folder and record; sources; bad input."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from commonrail.base.choices import Body, Boundary
from commonrail.physics.injector import Injector
from commonrail.plugins.sensitivity.verb import _subject
from tests.cli.conftest import Command, check_made_again

POINT = ("--rail-pressure", "160MPa", "--energising-time", "700us")
SMALL = ("--samples", "8", *POINT, "--feature", "quantity", "--feature", "opening_delay")


def test_an_injector_becomes_a_folder_with_a_report(command: Command, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    ranges = ("--parameter", "nozzle.hole_diameter=0.128mm:0.132mm", "--parameter", "valve.lift", "--within", "2%")
    done = command("sensitivity", "virtual-lino-2016", *SMALL, *ranges, "--out", folder, "--full")
    assert done.status == 0, done.err
    assert done.out.startswith("SYNTHETIC: ")
    assert re.search("2 parameters on 2 outputs, .*8 base points: 37 simulations", done.out)
    table = (folder / "sensitivity.csv").read_text(encoding="utf-8").splitlines()
    assert table[3].startswith("output,point,unit,parameter,at_low,at_high,swing,first,")
    assert len(table) == 4 + 4
    assert table[2].startswith("# SYNTHETIC: ")
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "Synthetic, not" in page
    assert "Tornado" in page
    assert "nan" not in (folder / "sensitivity.json").read_text(encoding="utf-8").lower().replace("nanometre", "")
    check_made_again(command, folder)
    assert command("sensitivity", "virtual-lino-2016", *SMALL, *ranges, "--out", folder).status == 2


def test_morris_gives_a_record(command: Command) -> None:
    names = ("--parameter", "nozzle.hole_diameter", "--parameter", "solenoid.resistance")
    done = command("sensitivity", "virtual-lino-2016", *SMALL, *names, "--design", "morris", "--json")
    record = done.record
    assert (record["kind"], record["design"], record["samples"]) == ("sensitivity", "morris", 8)
    quantity = record["outputs"][0]
    assert [row["name"] for row in quantity["parameters"]] == ["nozzle.hole_diameter", "solenoid.resistance"]
    first = quantity["parameters"][0]
    assert first["magnitude"]["low"] <= first["magnitude"]["value"] <= first["magnitude"]["high"]
    assert first["high"] > quantity["base"] > first["low"]


def test_a_study_and_its_run_have_j_in_their_bounds(command: Command, study: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    assert command("calibrate", study, "--out", run).status == 0
    of_study, of_run = (command("sensitivity", source, "--samples", "4", "--json").record for source in (study, run))
    assert [output["name"] for output in of_study["outputs"]] == ["J"]
    names = [p["name"] for p in of_study["ranges"]]
    assert names == [p["name"] for p in of_run["ranges"]]
    # the run is looked at about its calibrated values, where J is less
    assert of_run["outputs"][0]["base"] < of_study["outputs"][0]["base"]
    assert of_run["outputs"][0]["mean"] == of_study["outputs"][0]["mean"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("virtual-lino-2017", *POINT), "virtual-lino-2017"),
        (("virtual-lino-2016", "--rail-pressure", "160MPa"), "--energising-time"),
        (("virtual-lino-2016",), "--rail-pressure and --energising-time"),
        (("virtual-lino-2016", *POINT, "--feature", "quantitty"), '"quantity"'),
        (("virtual-lino-2016", *POINT, "--parameter", "valve.lft"), '"valve.lift"'),
        (("virtual-lino-2016", *POINT, "--parameter", "valve.lift=50um"), "NAME=LOW:HIGH"),
        (("virtual-lino-2016", *POINT, "--parameter", "valve.lift=50MPa:60um"), "is a pressure"),
        (("virtual-lino-2016", *POINT, "--samples", "100"), "128"),
        (("virtual-lino-2016", *POINT, "--design", "fast"), "--design"),
        ((".", *POINT), "run folder"),
        (("nothing.toml", *POINT), "nothing.toml: "),
    ],
)
def test_bad_input_ends_with_2_and_one_sentence(
    command: Command, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, arguments: tuple[str, ...], words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    done = command("sensitivity", *arguments, "--out", "folder")
    assert (done.status, done.out) == (2, "")
    assert words in done.sentence
    assert list(tmp_path.iterdir()) == []


def test_a_variant_is_named_as_elsewhere() -> None:
    subject = _subject("cri2-16@ideal,rigid")
    assert isinstance(subject, Injector)
    assert (subject.variant.boundary, subject.variant.body) == (Boundary.IDEAL, Body.RIGID)


def test_a_return_pressure_without_a_return_is_refused(command: Command) -> None:
    point = ("--rail-pressure", "10MPa", "--return-pressure", "1MPa")
    for verb in ("sensitivity", "simulate", "map", "sweep"):
        given = ("--vary", "dwell=1ms") if verb == "sweep" else () if verb == "map" else ("--energising-time", "1ms")
        done = command(verb, "direct-acting-kr@regulated", *point, *given)
        assert done.status == 2
        assert "--return-pressure: direct-acting-kr" in done.sentence
