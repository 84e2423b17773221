"""commonrail lab reproduce from the command line: the folder, the report of it, wrong inputs."""

from __future__ import annotations

from pathlib import Path

import pytest
from scipy.stats import binomtest

from commonrail.plugins.paper import run as repetition
from commonrail.plugins.paper.bench_file import load_truth
from commonrail.plugins.paper.verb import QUICK_SEEDS
from tests.cli.conftest import Command, Done, run_command
from tests.plugins.paper.conftest import measured, shorten


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("reproduce") / "run"


@pytest.fixture(scope="module")
def done(run: Path) -> Done:
    """One repetition of everything, with short searches, of curves that are simulated once."""
    with pytest.MonkeyPatch.context() as patch:
        shorten(patch)
        patch.setattr(repetition, "measure", lambda _, seed: measured(seed))
        return run_command("lab", "reproduce", "--seeds", "1", "--out", run, "--json")


def test_the_whole_study_runs_and_leaves_its_folder(done: Done, run: Path) -> None:
    assert done.status == 0, done.err
    assert sorted(p.name for p in run.iterdir()) == [
        "SHA256SUMS",
        "figures",
        "report.html",
        "reproduce.json",
        "traces.csv",
        "truth.toml",
    ]
    assert len(list((run / "figures").iterdir())) == 6
    record = done.record["result"]
    assert done.record["kind"] == "reproduction"
    assert record["seeds"] == [1]
    j = record["J"]["160 MPa"]
    assert j["optimised"][0] < j["theoretical"][0] < j["rigid"][0]
    assert "repetitions" in done.err


def test_its_truth_can_be_used_again_and_its_report_made_again(done: Done, run: Path, command: Command) -> None:
    assert done.status == 0
    page = run / "report.html"
    before = page.read_text()
    page.unlink()
    assert command("report", run).status == 0
    assert page.read_text() == before
    assert load_truth(run / "truth.toml").text == (run / "truth.toml").read_text()


def test_a_quick_run_has_the_fewest_seeds_that_bear_one_that_deviates() -> None:
    def told(true: int, of: int) -> bool:
        return bool(binomtest(true, of).proportion_ci(0.95).low > 0.5)

    assert told(QUICK_SEEDS - 1, QUICK_SEEDS)
    assert not any(told(n - 1, n) for n in range(1, QUICK_SEEDS))


def test_an_existing_folder_is_not_overwritten(done: Done, run: Path, command: Command) -> None:
    assert done.status == 0
    again = command("lab", "reproduce", "--quick", "--out", run)
    assert again.status == 2
    assert "overwritten" in again.sentence


@pytest.mark.parametrize("broken", ["reproduce.json", "traces.csv"])
def test_a_broken_folder_is_a_sentence(done: Done, run: Path, command: Command, tmp_path: Path, broken: str) -> None:
    assert done.status == 0
    for name in ("reproduce.json", "traces.csv"):
        text = (run / name).read_text()
        (tmp_path / name).write_text(text[: len(text) // 2] if name == broken else text)
    found = command("report", tmp_path)
    assert found.status == 2
    assert "reproduce again" in found.sentence


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--quick", "--seeds", "5"), "the two"),
        (("--seeds", "0"), "--seeds"),
        (("--truth", "virtual-lino-2017"), "virtual-lino-2016"),
        (("--truth", "no/such/truth.toml"), "truth.toml"),
    ],
)
def test_wrong_options_end_with_a_sentence_and_no_folder(
    command: Command, tmp_path: Path, options: tuple[str, ...], words: str
) -> None:
    done = command("lab", "reproduce", *options, "--out", tmp_path / "run")
    assert done.status == 2
    assert words in done.err
    assert "Traceback" not in done.err
    assert not (tmp_path / "run").exists()


def test_ctrl_c_before_a_repetition_is_complete_is_said(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("commonrail.plugins.paper.run.reproduce", stopped)
    done = command("lab", "reproduce", "--quick", "--out", tmp_path / "run")
    assert done.status == 130
    assert "to keep" in done.sentence
    assert not (tmp_path / "run").exists()
