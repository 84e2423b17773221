"""commonrail calibrate and the verbs that use its run folder."""

from __future__ import annotations

import json
import re
import shlex
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import pytest

from commonrail.base.errors import StudyError
from commonrail.base.hooks import _ask
from commonrail.calibration.record import CalibrationRecord, read_as
from commonrail.calibration.search import Progress
from commonrail.calibration.study_file import load_study
from commonrail.cli import fit
from commonrail.cli.console import SHORT, ShortForm
from commonrail.cli.fit import print_card
from commonrail.plugins import cluster
from commonrail.report.fit.verdict import verdict
from commonrail.runs.listing import list_runs
from tests.cli.conftest import Command, check_made_again, run_command, small_study

OWN = {
    "calibrated.toml",
    "draws.npz",
    "result.json",
    "traces.csv",
    "SHA256SUMS",
    "report.html",
    "journal.sqlite",
    "journal.lock",
}
FILES = OWN | {"study.toml", "injector.toml", "data"}  # the study with all that it reads


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """A small study, calibrated once by the command."""
    folder = tmp_path_factory.mktemp("calibrate")
    study, run = small_study(folder / "small"), folder / "run"
    arguments = ["calibrate", str(study), "--out", str(run), "--seed", "3", "--threads", "1"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fit, "JUDGED_SOON", 0.0)
        result = run_command(*arguments, "--json")
    assert result.status == 0, result.err
    return {"study": study, "run": run, "out": result.out, "err": result.err}


def test_the_run_folder_is_complete(finished: dict[str, Any]) -> None:
    assert {path.name for path in finished["run"].iterdir()} == FILES


def test_the_checksums_of_a_run_are_no_input_of_its_study(finished: dict[str, Any]) -> None:
    """They change whenever results are written again, and a run of that study would count as changed."""
    names = {path.name for path in load_study(finished["run"] / "study.toml").files}
    assert names == {"study.toml", "injector.toml", "evi.csv"}


def test_stdout_is_one_object_with_the_result(finished: dict[str, Any]) -> None:
    record = json.loads(finished["out"])
    own = json.loads((finished["run"] / "result.json").read_text(encoding="utf-8"))
    assert record["result"] == own
    assert record["report"] == str(finished["run"] / "report.html")
    assert own["seed"] == 3  # the option, not the file
    assert own["optimiser"]["initial"] == "feasible"
    assert own["optimiser"]["generations"] == 2  # after the first population


def test_progress_goes_to_stderr(finished: dict[str, Any]) -> None:
    assert "evolution 3/3" in finished["err"]


def test_the_judgement_of_a_fit_shows_its_stages(finished: dict[str, Any]) -> None:
    """A study of hundreds of curves is judged for minutes."""
    _, _, after = finished["err"].partition("judging")
    assert re.search(r"^\w+ \d+/\d+: ", after, re.MULTILINE)


def test_the_calibrated_injector_can_be_simulated(command: Command, finished: dict[str, Any]) -> None:
    point = ("--rail-pressure", "160MPa", "--energising-time", "700us", "--json")
    record = command("simulate", finished["run"] / "calibrated.toml", *point).record
    best = json.loads(finished["out"])["result"]["data"][0]["volume"]["best"]
    # the study's window ends 1.6 ms after the start, when nothing flows any more
    assert record["injected_volume"] == pytest.approx(best, rel=1e-3)


def test_comparing_the_run_gives_its_own_figures(command: Command, finished: dict[str, Any]) -> None:
    done = command("compare", f"best={finished['run']}", "--data", finished["study"], "--json")
    own = json.loads(finished["out"])["result"]["data"][0]
    (data,) = done.record["data"]
    assert data["J"]["best"] == pytest.approx(own["J"]["best"], rel=1e-9)


def test_comparing_prints_a_table_and_what_is_synthetic(command: Command, finished: dict[str, Any]) -> None:
    done = command("compare", finished["run"] / "calibrated.toml", "--data", finished["study"])
    assert done.status == 0
    assert "SYNTHETIC: " in done.out
    assert "Error J" in done.out


def test_comparing_tells_what_is_implausible(command: Command, study: Path) -> None:
    done = command("compare", "virtual-lino-2016", "--data", study, "--json")
    assert done.record["warnings"] == []
    text = study.read_text(encoding="utf-8")
    study.write_text(text.replace('energising_time = "700 us"', 'energising_time = "0.7 us"'), encoding="utf-8")
    done = command("compare", "virtual-lino-2016", "--data", study, "--json")
    assert [w["code"] for w in done.record["warnings"]] == ["energising", "quantity"]
    assert all(f"warning: {w['sentence']}\n" in done.err for w in done.record["warnings"])


def test_the_line_of_the_report_counts_the_warnings(command: Command, study: Path, tmp_path: Path) -> None:
    text = study.read_text(encoding="utf-8")
    study.write_text(text.replace('energising_time = "700 us"', 'energising_time = "0.7 us"'), encoding="utf-8")
    done = command("calibrate", study, "--out", tmp_path / "run")
    assert done.status == 0
    assert f"report: {tmp_path / 'run' / 'report.html'} (3 warnings at its top)" in done.out.splitlines()
    assert done.out.startswith("SYNTHETIC: ")
    assert "Parameters\n" not in done.out


def test_the_tables_are_printed_where_they_are_asked_for(command: Command, finished: dict[str, Any]) -> None:
    done = command("resume", finished["run"], "--full")
    verdict = done.out.partition("\nParameters\n")[2]
    assert "control_chamber.z_hole_diameter" in verdict
    assert "\n  commonrail " in verdict  # the next steps come last


def test_the_card_fits_a_narrow_terminal_and_its_commands_can_be_copied(
    finished: dict[str, Any], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    record = json.loads(finished["out"])["result"]
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    run = "runs/" + "long-name-" * 5  # whose commands do not fit
    fit_record = read_as(CalibrationRecord, record)
    with click.Context(click.Command("calibrate")) as context:
        context.meta[SHORT] = ShortForm()
        print_card(fit_record, run)
    lines = click.unstyle(capsys.readouterr().out).splitlines()
    assert len(lines) <= 25  # a screen of a terminal
    assert max(map(len, lines)) <= 80
    words = " ".join(" ".join(lines).split())
    advised = verdict(fit_record, run).steps
    steps = [step for step in advised if step.text in words]  # whole, or left out
    assert steps == advised[: len(steps)]
    copied = "\n".join(lines).replace("\\\n", " ").splitlines()
    commands = [step.command for step in steps if step.command]
    assert commands
    assert [shlex.split(line) for line in copied if line.startswith("  commonrail")] == [*map(shlex.split, commands)]


def test_the_report_can_be_made_again(command: Command, finished: dict[str, Any]) -> None:
    check_made_again(command, finished["run"])
    found = command("report", finished["run"], "--json").record["report"]
    assert found == str(finished["run"] / "report.html")


def test_a_used_run_folder_is_not_touched(command: Command, finished: dict[str, Any]) -> None:
    before = {p.name: p.stat().st_mtime_ns for p in finished["run"].iterdir()}
    done = command("calibrate", finished["study"], "--out", finished["run"])
    assert (done.status, done.out) == (2, "")
    assert re.search(r"run.*: .*overwritten", done.sentence)
    assert {p.name: p.stat().st_mtime_ns for p in finished["run"].iterdir()} == before


def test_a_folder_that_cannot_be_made_is_refused(command: Command, study: Path) -> None:
    done = command("calibrate", study, "--out", study / "run")
    assert done.status == 3
    assert "be written" in done.sentence


def test_without_out_runs_are_numbered(
    command: Command, study: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    asked: list[Path] = []

    def note(_study: object, folder: Path, *_: object, **__: object) -> None:
        asked.append(folder)
        raise StudyError("enough.")

    monkeypatch.setattr("commonrail.cli.fit.run_study", note)
    monkeypatch.chdir(tmp_path)
    command("calibrate", study)
    (tmp_path / "runs" / "small-1").mkdir(parents=True)
    command("calibrate", study)
    renamed = study.rename(study.with_name("second.toml"))
    command("calibrate", renamed)
    # a file called study.toml says less than its folder
    assert [p.as_posix() for p in asked] == ["runs/small-1", "runs/small-2", "runs/second-1"]


@pytest.mark.parametrize("error", [StudyError("nothing could be simulated."), ValueError("x")])
def test_a_search_that_fails_leaves_no_folder(
    command: Command, study: Path, monkeypatch: pytest.MonkeyPatch, error: Exception, tmp_path: Path
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr("commonrail.runs.fit.calibrate", fail)
    done = command("calibrate", study, "--out", tmp_path / "run")
    assert done.status == (2 if isinstance(error, StudyError) else 1)
    assert done.sentence
    assert not (tmp_path / "run").exists()


def interrupt_at(number: int) -> Callable[..., Any]:
    """A calibration during which Ctrl-C is pressed after so many generations."""
    from commonrail.calibration.run import calibrate

    def interrupted(study: Any, *, progress: Callable[..., None], **how: Any) -> Any:
        def press(state: Progress) -> None:
            progress(state)
            if state.generation == number:
                raise KeyboardInterrupt

        return calibrate(study, progress=press, **how)

    return interrupted


def test_ctrl_c_writes_the_best_so_far_and_ends_with_130(
    command: Command, study: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("commonrail.runs.fit.calibrate", interrupt_at(2))
    done = command("calibrate", study, "--out", tmp_path / "run", "--json")
    assert done.status == 130
    run = tmp_path / "run"
    assert (
        done.sentence == f"interrupted; the best values so far are in {run}. `commonrail resume {run}` resumes the run."
    )
    assert done.record["result"]["status"] == "interrupted"
    assert len(done.record["result"]["generations"]) == 2
    assert {path.name for path in (tmp_path / "run").iterdir()} == FILES


def test_ctrl_c_in_the_judgement_keeps_the_fit_and_resume_judges_it(
    command: Command, study: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    from commonrail.calibration.identifiability import identify

    def pressed(*arguments: Any, **more: Any) -> Any:
        _ask(signal.SIGTERM, None)
        return identify(*arguments, **more)

    run = tmp_path / "run"
    with monkeypatch.context() as patch:
        patch.setattr("commonrail.runs.fit.identify", pressed)
        done = command("calibrate", study, "--out", run, "--json")
    assert done.status == 130
    assert done.sentence == (
        f"interrupted; the fit is in {run}, but not how well the data determine it. `commonrail resume {run}` judges "
        "that."
    )
    assert "certainty" not in done.record["result"]
    assert {path.name for path in run.iterdir()} == FILES - {"draws.npz"}
    assert list_runs(run)[0].state == "interrupted"
    judged = command("resume", run, "--json")
    assert judged.status == 0
    assert "certainty" in judged.record["result"]


def test_a_search_that_was_stopped_is_judged(
    command: Command, study: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    from commonrail.calibration.run import calibrate

    def pressed(study: Any, *, progress: Callable[..., None], **how: Any) -> Any:
        return calibrate(study, progress=lambda _: _ask(signal.SIGTERM, None), **how)

    monkeypatch.setattr("commonrail.runs.fit.calibrate", pressed)
    done = command("calibrate", study, "--out", tmp_path / "run", "--json")
    assert done.status == 130
    assert "certainty" in done.record["result"]


def test_a_study_that_cannot_be_read_ends_with_2(command: Command, tmp_path: Path) -> None:
    done = command("calibrate", tmp_path / "none.toml", "--out", tmp_path / "run")
    assert done.status == 2
    assert "none.toml" in done.sentence
    assert not (tmp_path / "run").exists()


def test_report_says_which_command_makes_a_fleet_s(command: Command, tmp_path: Path) -> None:
    (tmp_path / "fleet.json").write_text('{"schema": 1, "kind": "fleet"}', encoding="utf-8")
    done = command("report", tmp_path)
    assert done.status == 2
    assert f"`commonrail fleet FLEET --out {tmp_path}`" in done.sentence


def test_report_refuses_what_is_no_run_folder(command: Command, tmp_path: Path) -> None:
    done = command("report", tmp_path)
    assert done.status == 2
    assert "run folder" in done.sentence


@pytest.mark.slow  # tests/cli/test_resume.py resumes with workers, tests/runs/test_workers.py compares all bytes
def test_workers_give_the_same_result(command: Command, finished: dict[str, Any], tmp_path: Path) -> None:
    options = ("--out", tmp_path / "run", "--seed", "3", "--workers", "2", "--json")
    found = command("calibrate", finished["study"], *options).record["result"]
    own = json.loads(finished["out"])["result"]
    for key in ("parameters", "objective", "generations", "data", "evaluations", "warnings"):
        assert found[key] == own[key]


def test_a_scheduler_that_is_not_there_is_a_sentence(
    command: Command, finished: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed", reason="the extra [cluster] is not installed")
    monkeypatch.setattr(cluster, "CONNECT", 0.5)
    done = command("calibrate", finished["study"], "--out", tmp_path / "run", "--cluster", "tcp://127.0.0.1:1")
    assert done.status == 2
    assert "tcp://127.0.0.1:1" in done.sentence
    assert not (tmp_path / "run").exists()
