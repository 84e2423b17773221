"""commonrail compare."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from commonrail.base.choices import Drive
from commonrail.readers.injector import load_injector
from commonrail.readers.injector_writer import dump_injector
from tests.cli.conftest import Command, check_made_again, run_command

NAME = "virtual-lino-2016"
CASE = Path(__file__).resolve().parents[3] / "cases" / "paper" / "study.toml"


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Three models, one of which fails, on the paper's case, compared once into a folder."""
    folder = tmp_path_factory.mktemp("compare")
    weak = folder / "weak.toml"
    dump_injector(load_injector(NAME).with_values({"valve.spring_preload": 1.0}), weak)
    arguments = [NAME, f"stiff, one mass={NAME}@rigid", str(weak), "--data", str(CASE), "--threads", "1"]
    out = folder / "out"
    result = run_command("compare", *arguments, "--out", out)
    assert result.status == 0, result.err
    return {"arguments": arguments, "folder": out, "out": result.out}


def record_of(done: dict[str, Any]) -> dict[str, Any]:
    """comparison.json."""
    loaded: dict[str, Any] = json.loads((done["folder"] / "comparison.json").read_text(encoding="utf-8"))
    return loaded


def test_the_folder_is_complete(done: dict[str, Any]) -> None:
    assert {p.name for p in done["folder"].iterdir()} == {"comparison.json", "traces.csv", "report.html", "SHA256SUMS"}
    assert list(record_of(done)["labels"]) == [NAME, "stiff, one mass", "weak"]


def test_j_can_be_computed_again_from_the_curves_alone(done: dict[str, Any]) -> None:
    lines = (done["folder"] / "traces.csv").read_text(encoding="utf-8").splitlines()
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    data = {d["name"]: d for d in record_of(done)["data"]}
    assert {row["data"] for row in rows} == set(data) == {"160 MPa", "120 MPa", "80 MPa"}
    for name, d in data.items():
        own = [row for row in rows if row["data"] == name]
        assert len(own) == d["samples"] == 520
        for label in (NAME, "stiff, one mass"):
            j = sum(abs(float(row[f"{label} [mm3/ms]"]) - float(row["measured [mm3/ms]"])) for row in own)
            # every number has all its digits: what is left is the rounding of sums of 520
            assert j == pytest.approx(d["J"][label], rel=1e-12)
        assert {row["weak [mm3/ms]"] for row in own} == {""}


def test_a_drive_that_the_data_do_not_have_is_refused(command: Command, tmp_path: Path) -> None:
    own = load_injector(NAME)
    dump_injector(replace(own, variant=own.variant._replace(drive=Drive.VOLTAGE)), tmp_path / "driven.toml")
    found = command("compare", tmp_path / "driven.toml", "--data", CASE)
    assert (found.status, found.out) == (2, "")
    assert "voltage trace" in found.sentence
    assert '"160 MPa"' in found.sentence


def test_stdout_has_the_tables_and_what_is_synthetic(done: dict[str, Any]) -> None:
    assert done["out"].startswith("SYNTHETIC: ")
    for words in ("Error J", "stiff, one mass", "★", "Points without", "report: "):
        assert words in done["out"]


def test_the_report_can_be_made_again(command: Command, done: dict[str, Any]) -> None:
    check_made_again(command, done["folder"])


def test_json_is_the_record_and_nothing_is_written(
    command: Command, done: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    found = command("compare", *done["arguments"], "--json")
    assert found.status == 0
    assert found.record == record_of(done)
    assert list(tmp_path.iterdir()) == []


def test_a_used_folder_is_not_touched(command: Command, done: dict[str, Any]) -> None:
    before = {p.name: p.stat().st_mtime_ns for p in done["folder"].iterdir()}
    found = command("compare", *done["arguments"], "--out", done["folder"])
    assert (found.status, found.out) == (2, "")
    assert str(done["folder"]) in found.sentence
    assert {p.name: p.stat().st_mtime_ns for p in done["folder"].iterdir()} == before


def test_if_nothing_can_be_simulated_it_ends_with_4_and_leaves_nothing(
    command: Command, done: dict[str, Any], tmp_path: Path
) -> None:
    found = command("compare", done["arguments"][2], "--data", CASE, "--out", tmp_path / "x")
    assert (found.status, found.out) == (4, "")
    assert found.sentence
    assert not (tmp_path / "x").exists()


@pytest.mark.parametrize(
    ("models", "words"),
    [
        (("nothing",), "nothing"),
        ((f"{NAME}@rigit",), '"rigid"'),
        ((f"a={NAME}", f"a={NAME}"), '"a"'),
        ((NAME,) * 9, " 8 "),
        ((f"{NAME}@current-trace",), "current trace"),
    ],
)
def test_what_cannot_be_compared_is_one_sentence(
    command: Command, tmp_path: Path, models: tuple[str, ...], words: str
) -> None:
    found = command("compare", *models, "--data", CASE, "--out", tmp_path / "x")
    assert (found.status, found.out) == (2, "")
    assert words in found.sentence
    assert not (tmp_path / "x").exists()


def test_data_must_be_named(command: Command) -> None:
    found = command("compare", NAME)
    assert found.status == 2
    assert "--data" in found.err


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("traces.csv", "data,time [us],measured [mm3/ms]\na,1.0,oops\n", 'line 2, column "measured [mm3/ms]": "oops"'),
        ("traces.csv", "data,time [us]\n", "traces.csv"),
        ("traces.csv", "", "traces.csv"),
        ("comparison.json", "[" * 100_000, "commonrail compare"),
        ("comparison.json", "{}", "commonrail compare"),
    ],
)
def test_a_broken_folder_is_one_sentence(
    command: Command, done: dict[str, Any], tmp_path: Path, name: str, text: str, words: str
) -> None:
    for file in ("comparison.json", "traces.csv"):
        (tmp_path / file).write_bytes((done["folder"] / file).read_bytes())
    (tmp_path / name).write_text(text, encoding="utf-8")
    found = command("report", tmp_path)
    assert (found.status, found.out) == (2, "")
    assert words in found.sentence
