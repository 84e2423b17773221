"""commonrail tolerance: tables, folder and record; a study that is stopped; bad input."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Any

import pytest

from tests.cli.conftest import Command, check_made_again
from tests.plugins.tolerance.test_tolerance_file import HEAD, HOLE, written

TRIM = '[trim]\npoints = ["full"]\nparts = 100\n'
SMALL = HEAD.replace("title =", "parts = 1000\ntitle =") + HOLE + TRIM


def test_a_file_becomes_a_folder_with_a_report(command: Command, tmp_path: Path) -> None:
    file, folder = (
        written(tmp_path, SMALL.replace('title = "t"', 'title = "t"\nsynthetic = "assumed"')),
        tmp_path / "out",
    )
    done = command("tolerance", file, "--out", folder)
    assert done.status == 0, done.err
    assert done.out.startswith("SYNTHETIC: assumed The injector is virtual")
    assert "1,000 parts" in done.out
    assert "nozzle.hole_diameter" in (folder / "tolerance.csv").read_text(encoding="utf-8")
    assert (folder / "tolerances.toml").read_bytes() == file.read_bytes()
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "Synthetic, not" in page
    assert "test points" in page
    check_made_again(command, folder)


def test_options_replace_what_the_file_says(command: Command, tmp_path: Path) -> None:
    file = written(tmp_path, SMALL.replace(TRIM, ""))
    record = command("tolerance", file, "--parts", "1024", "--seed", "7", "--json").record
    assert (record["kind"], record["parts"], record["seed"], record["trim"]) == ("tolerance", 1024, 7, None)
    spread = record["points"][0]["spread"]
    assert spread["out"]["low"] <= spread["out"]["value"] < spread["out"]["high"]
    assert record["points"][0]["dimensions"][0]["share"]["value"] == pytest.approx(1.0, abs=0.01)


def test_a_study_that_is_stopped_ends_with_130_and_a_report(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def show(self: Any, stage: Any) -> None:
        if stage.done:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr("commonrail.cli.console.Bar.show", show)
    folder = tmp_path / "out"
    done = command("tolerance", written(tmp_path, SMALL), "--out", folder)
    assert done.status == 130
    assert "64 of 1,000 parts" in done.err
    assert "64 of 1000 parts" in (folder / "report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (SMALL.replace('"0.6 um"', '"60 um"'), "domain"),
        (SMALL.replace('"-4 %"', '"4 m"'), "point[1].lower: "),
        (SMALL.replace('"-4 %"', '"60 mm3"'), "full: "),
    ],
)
def test_bad_input_ends_with_2_and_leaves_nothing(command: Command, tmp_path: Path, text: str, words: str) -> None:
    done = command("tolerance", written(tmp_path, text), "--out", tmp_path / "out")
    assert (done.status, done.out) == (2, "")
    assert words in done.sentence
    assert not (tmp_path / "out").exists()


def test_a_study_file_is_told_apart(command: Command, study: Path) -> None:
    done = command("tolerance", study)
    assert done.status == 2
    assert "commonrail-study/1" in done.sentence
