"""A run whose calibrated values are the most likely ones, with its draws; more starts by the verb."""

from __future__ import annotations

import errno
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import commonrail as cr
from commonrail.base.errors import InputError
from commonrail.plugins.new.study import write_new
from commonrail.runs.folder import read_draws
from tests.cli.conftest import run_command


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run of the example of `commonrail new`, its search cut short: the estimate climbs on from there."""
    folder = tmp_path_factory.mktemp("posterior") / "own"
    write_new(folder)
    text = (folder / "study.toml").read_text(encoding="utf-8").replace("generations = 30", "generations = 2")
    (folder / "study.toml").write_text(text.replace("polish = 3", "polish = 1"), encoding="utf-8")
    found = folder.parent / "run"
    assert run_command("calibrate", folder / "study.toml", "--out", found, "--threads", 1).status == 0
    return found


def result_of(run: Path) -> dict[str, Any]:
    """The result without what depends on the clock."""
    record: dict[str, Any] = json.loads((run / "result.json").read_text(encoding="utf-8"))
    return {key: value for key, value in record.items() if key != "clock"}


def test_the_calibrated_values_are_the_most_likely_ones(run: Path) -> None:
    """The search of this run was cut short: the estimate climbs on from there, and all of the run follows."""
    record = result_of(run)
    likely = {one["name"]: one["value"] for one in record["certainty"]["parameters"]}
    assert {p["name"]: p["best"] for p in record["parameters"]} == likely
    calibrated = cr.load_injector(run / "calibrated.toml")
    assert all(calibrated.values[name] == pytest.approx(value, rel=1e-12) for name, value in likely.items())
    (listed,) = cr.runs.list_runs(run)
    assert listed.best == record["objective"]["best"]
    scored = cr.compare({"best": calibrated}, cr.load_study(run / "study.toml"), threads=1).scores["best"]
    assert [score.j for score in scored] == pytest.approx([d["J"]["best"] for d in record["data"]], rel=1e-9)


def test_the_draws_of_a_run_are_those_of_its_intervals(run: Path) -> None:
    record = result_of(run)
    names = [one["name"] for one in record["parameters"]]
    points = read_draws(run, names)
    assert "draws.npz" in (run / "SHA256SUMS").read_text(encoding="utf-8")
    for one, column in zip(record["certainty"]["parameters"], points.T, strict=True):
        low, high = np.quantile(column, [0.025, 0.975])
        half = 0.5 * (one["upper"] - one["lower"])
        # a quarter of the draws is kept: their quantiles scatter by 8 %
        np.testing.assert_allclose([low, high], [one["lower"], one["upper"]], atol=0.3 * half)
    with pytest.raises(InputError, match="other parameters"):
        read_draws(run, names[:-1])


def test_more_starts_stay_when_a_run_is_resumed(run: Path, tmp_path: Path) -> None:
    own = shutil.copytree(run, tmp_path / "own")
    assert run_command("certainty", own, "--starts", 3, "--threads", 1).status == 0
    before = result_of(own)
    assert before["certainty"]["starts"] == 3
    assert run_command("resume", own, "--threads", 1).status == 0
    assert result_of(own) == before


def test_a_folder_that_cannot_be_written_is_refused_before_the_work(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def barred(*_: object, **__: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr("tempfile.TemporaryFile", barred)
    monkeypatch.setattr("commonrail.runs.fit.estimate_again", None)
    done = run_command("certainty", run)
    assert done.status == 3
    assert f"{run} cannot be written (Permission denied)" in done.sentence


def test_a_stated_limit_writes_nothing_even_if_it_is_the_default(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("commonrail.runs.fit.estimate_again", None)
    before = {path.name: path.read_bytes() for path in run.iterdir() if path.is_file()}
    done = run_command("certainty", run, "--starts", 1, "--limit", 10, "--threads", 1)
    assert done.status == 0, done.err
    assert {path.name: path.read_bytes() for path in run.iterdir() if path.is_file()} == before


def test_the_verdicts_of_a_stated_limit_are_counted(run: Path) -> None:
    done = run_command("certainty", run, "--starts", 1, "--limit", 0.1, "--threads", 1)
    assert done.status == 0, done.err
    count = len(result_of(run)["parameters"])
    assert done.out.startswith(f"{count} parameters: ")
    assert f"{count} determined" not in done.out


def test_a_limit_that_is_no_number_is_refused_before_the_work(tmp_path: Path) -> None:
    done = run_command("certainty", tmp_path, "--limit", "nan")
    assert done.status == 2
    assert "'--limit': nan is not a finite number" in done.sentence


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", 'is no sum of free parameters; write a sum such as "'),
        ("0*x", 'names "x", which is not a free parameter'),
        ("2", "is no sum of free parameters"),
        ("nozzle.discharge_maximum + 2", "is no sum of free parameters"),
        ("nozzle.discharge_maximum > 0", "is no sum of free parameters"),
        ("0*nozzle.discharge_maximum", "is no sum of free parameters"),
    ],
)
def test_what_is_no_combination_is_refused_by_its_option(run: Path, text: str, words: str) -> None:
    done = run_command("certainty", run, "--combination", text)
    assert done.status == 2
    assert f'--combination "{text}" {words}' in done.sentence


def test_a_stated_combination_is_printed_first(run: Path) -> None:
    name = result_of(run)["parameters"][0]["name"]
    done = run_command("certainty", run, "--starts", 1, "--combination", f"2*{name}", "--threads", 1)
    assert done.status == 0, done.err
    assert f"2*{name}" in done.out
