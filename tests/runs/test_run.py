"""A run goes on to the same bits, wherever it was stopped, moved or lengthened."""

from __future__ import annotations

import os
import shutil
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from commonrail.base.errors import (
    CommonrailError,
    ConfigurationError,
    InputError,
    OutputError,
    SimulationError,
    StudyError,
)
from commonrail.calibration.identifiability import identify
from commonrail.calibration.space import Space
from commonrail.calibration.study_file import load_study
from commonrail.runs.fit import Listener, calibrate_into, resume
from commonrail.runs.journal import Journal
from commonrail.runs.listing import list_runs
from tests.runs.conftest import (
    GENERATIONS,
    REFINEMENTS,
    Stop,
    Stopped,
    Whole,
    stop_after,
    stopped_run,
    timeless,
    write_small,
)

ALL = 1 + GENERATIONS + REFINEMENTS


@pytest.mark.parametrize("steps", range(1, ALL + 1))
def test_a_run_killed_after_any_step_ends_as_one_never_stopped(whole: Whole, stopped: Stop, steps: int) -> None:
    run = stopped(steps)
    resume(run, threads=1)
    assert timeless(run) == timeless(whole.run)
    assert (run / "calibrated.toml").read_bytes() == (whole.run / "calibrated.toml").read_bytes()
    assert (run / "traces.csv").read_bytes() == (whole.run / "traces.csv").read_bytes()


def test_warnings_are_told_again_and_stand_in_the_same_bytes(tmp_path: Path, study_file: Path) -> None:
    text = study_file.read_text(encoding="utf-8")
    study_file.write_text(text.replace('energising_time = "700 us"', 'energising_time = "0.7 us"'), encoding="utf-8")
    study = load_study(study_file)
    told: list[str] = []
    calibrate_into(tmp_path / "whole", study, threads=2, listener=Listener(note=told.append))
    stopped_run(tmp_path / "stopped", study, 3)
    again: list[str] = []
    found = resume(tmp_path / "stopped", threads=1, listener=Listener(note=again.append))
    assert [w.code for w in found.warnings] == ["energising", "quantity", "moved"]
    warnings = [f"warning: {w.sentence}" for w in found.warnings]
    assert [line for line in told if line.startswith("warning: ")] == warnings
    assert [line for line in again if line.startswith("warning: ")] == warnings
    assert timeless(tmp_path / "stopped") == timeless(tmp_path / "whole")


def test_a_strict_run_of_an_implausible_study_leaves_nothing(tmp_path: Path, study_file: Path) -> None:
    text = study_file.read_text(encoding="utf-8")
    study_file.write_text(text.replace('energising_time = "700 us"', 'energising_time = "0.7 us"'), encoding="utf-8")
    with pytest.raises(StudyError, match=r"nothing .* 700 ns"):
        calibrate_into(tmp_path / "run", load_study(study_file), strict=True)
    assert not (tmp_path / "run").exists()


def test_what_was_done_is_not_done_again(stopped: Stop) -> None:
    told: list[tuple[str, int]] = []
    run = stopped(4)
    resume(run, listener=Listener(lambda p: told.append((p.phase, p.generation))))
    assert told[0] == ("evolution", 5)


def test_stopping_again_and_again_changes_nothing(whole: Whole, stopped: Stop) -> None:
    run = stopped(1)
    for _ in range(2, ALL):
        with pytest.raises(Stopped):
            resume(run, threads=1, listener=stop_after(1))
    resume(run)
    assert timeless(run) == timeless(whole.run)


def test_a_run_that_was_moved_goes_on_without_its_study(whole: Whole, stopped: Stop, study_file: Path) -> None:
    run = stopped(3)
    shutil.rmtree(study_file.parent)
    moved = run.rename(run.with_name("elsewhere"))
    resume(moved)
    assert timeless(moved) == timeless(whole.run)


def test_a_copy_goes_on_too(whole: Whole, stopped: Stop, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(stopped(3), copy)
    resume(copy)
    assert timeless(copy) == timeless(whole.run)


def test_another_number_of_threads_may_go_on(whole: Whole, stopped: Stop) -> None:
    run = stopped(2)
    resume(run, threads=2)
    assert timeless(run) == timeless(whole.run)


def test_a_finished_run_is_judged_and_written_anew_to_the_same_bytes(
    whole: Whole, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("commonrail.runs.fit.identify", identify)  # whatever was found before
    copy = tmp_path / "copy"
    shutil.copytree(whole.run, copy)
    (copy / "result.json").unlink()
    resume(copy)
    assert timeless(copy) == timeless(whole.run)


@pytest.mark.parametrize("steps", [3, ALL])
def test_more_generations_give_what_a_longer_study_gives(tmp_path: Path, study_file: Path, steps: int) -> None:
    longer = study_file.read_text(encoding="utf-8").replace(f"generations = {GENERATIONS}", "generations = 7")
    (study_file.parent / "longer.toml").write_text(longer, encoding="utf-8")
    calibrate_into(tmp_path / "longer", load_study(study_file.parent / "longer.toml"))
    run = stopped_run(tmp_path / "run", load_study(study_file), steps)
    resume(run, generations=2)
    assert timeless(run) == timeless(tmp_path / "longer")
    assert load_study(run / "study.toml").method.evolution.generations == 7
    resume(run)  # its study.toml is its own again
    assert timeless(run) == timeless(tmp_path / "longer")


@pytest.mark.parametrize("steps", [3, ALL])
def test_a_crash_while_it_is_lengthened_does_no_harm(
    tmp_path: Path, study_file: Path, monkeypatch: pytest.MonkeyPatch, steps: int
) -> None:
    # with this seed the refinements of the shorter run, if they were kept, would end elsewhere
    study_file.write_text(study_file.read_text(encoding="utf-8").replace("seed = 1", "seed = 2"), encoding="utf-8")
    run = stopped_run(tmp_path / "run", load_study(study_file), steps)

    def crash(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("commonrail.runs.fit.write_text", crash)  # the journal knows, study.toml does not
        with pytest.raises(KeyboardInterrupt):
            resume(run, generations=2)
    assert len(resume(run).history) == 1 + GENERATIONS + 2
    longer = study_file.read_text(encoding="utf-8").replace(f"generations = {GENERATIONS}", "generations = 7")
    study_file.write_text(longer, encoding="utf-8")
    calibrate_into(tmp_path / "longer", load_study(study_file))
    assert timeless(run) == timeless(tmp_path / "longer")  # the refinements of the shorter one are forgotten
    assert load_study(run / "study.toml").method.evolution.generations == GENERATIONS + 2


def test_another_seed_than_the_file_s_is_kept(tmp_path: Path, study_file: Path) -> None:
    study = replace(load_study(study_file), seed=11)
    calibrate_into(tmp_path / "whole", study)
    run = stopped_run(tmp_path / "run", study, 2)
    assert load_study(run / "study.toml").seed == 11
    resume(run)
    assert timeless(run) == timeless(tmp_path / "whole")


def test_a_study_changed_in_python_is_asked_for_again(tmp_path: Path, study_file: Path) -> None:
    study = load_study(study_file)
    first = study.space.parameters[0]
    narrow = replace(first, upper=0.9 * first.upper)
    changed = replace(study, space=Space((narrow, *study.space.parameters[1:]), study.space.rows))
    calibrate_into(tmp_path / "whole", changed)
    run = stopped_run(tmp_path / "run", changed, 3)
    with pytest.raises(StudyError, match=r"Python.*resume\(folder, study=study\)"):
        resume(run)
    with pytest.raises(StudyError, match="reads differently"):
        resume(run, study=study)
    resume(run, study=changed)
    assert timeless(run) == timeless(tmp_path / "whole")


def test_a_changed_file_of_the_run_is_refused(stopped: Stop) -> None:
    run = stopped(3)
    data = run / "data" / "evi.csv"
    data.write_text(data.read_text(encoding="utf-8") + "\n", encoding="utf-8")
    with pytest.raises(StudyError, match=r"run/data/evi\.csv .*changed"):
        resume(run)
    data.unlink()
    with pytest.raises(StudyError, match=r"run/data/evi\.csv .*missing"):
        resume(run)


def test_a_changed_study_is_refused_with_what_changed(stopped: Stop, whole: Whole, study_file: Path) -> None:
    run = stopped(3)
    for path in (run / "study.toml", study_file):
        before = path.read_text(encoding="utf-8")
        path.write_text(before.replace("members = 8", "members = 9"), encoding="utf-8")
        with pytest.raises(StudyError, match=r"study\.toml .*changed.*optimiser\.members: 8 -> 9"):
            resume(run)
        if path.parent == run:
            path.write_text(before, encoding="utf-8")
    resume(run, as_begun=True)
    assert timeless(run) == timeless(whole.run)


def test_changed_data_are_refused(stopped: Stop, study_file: Path) -> None:
    run = stopped(3)
    data = study_file.parent / "data" / "evi.csv"
    data.write_text(data.read_text(encoding="utf-8").replace("0.0", "0.1", 1), encoding="utf-8")
    with pytest.raises(StudyError, match=r"small/data/evi\.csv .*--as-begun"):
        resume(run)


def test_two_at_once_are_told_of_each_other(stopped: Stop) -> None:
    run = stopped(2)
    with Journal(run) as journal:
        journal.start_session()
        with pytest.raises(StudyError, match=rf"process {os.getpid()} .* 20"):
            resume(run)
        assert [r.state for r in list_runs(run)] == ["running"]
    resume(run)


def test_nothing_to_go_on_with(tmp_path: Path) -> None:
    with pytest.raises(StudyError, match="`commonrail runs DIR`"):
        resume(tmp_path / "none")
    with pytest.raises(StudyError, match=r"`commonrail runs [^D]"):
        resume(tmp_path)
    with pytest.raises(ConfigurationError, match=r"generations .*-1"):
        resume(tmp_path, generations=-1)


def test_a_used_folder_is_refused(whole: Whole, tmp_path: Path) -> None:
    (tmp_path / "note.txt").touch()
    for folder in (whole.run, tmp_path):
        with pytest.raises(InputError, match=rf"/{folder.name}: .*overwritten"):
            calibrate_into(folder, load_study(whole.study))
    assert [path.name for path in tmp_path.iterdir()] == ["note.txt"]


def test_a_run_killed_before_it_was_ready_can_be_begun_again(whole: Whole, tmp_path: Path) -> None:
    run = tmp_path / "run"
    run.mkdir()
    Journal(run).close()  # killed before the study was copied
    with pytest.raises(StudyError, match="no run"):
        resume(run)
    calibrate_into(run, load_study(whole.study))
    assert timeless(run) == timeless(whole.run)


def test_a_search_without_any_simulation_leaves_nothing(tmp_path: Path, study_file: Path) -> None:
    text = study_file.read_text(encoding="utf-8").replace('role = "fit"', 'role = "validation"')
    study_file.write_text(text, encoding="utf-8")
    with pytest.raises(StudyError, match="role fit"):
        calibrate_into(tmp_path / "run", load_study(study_file))
    assert not (tmp_path / "run").exists()


def test_a_search_in_which_all_fail_says_why_and_stays(tmp_path: Path, study_file: Path) -> None:
    text = study_file.read_text(encoding="utf-8").replace('time_step = "auto"', 'time_step = "20 us"')
    assert "20 us" in text
    study_file.write_text(text, encoding="utf-8")
    study = load_study(study_file)
    with pytest.raises(SimulationError, match=r"\d+ candidates .*\d+ .*: The time step"):
        calibrate_into(tmp_path / "run", study)
    (found,) = list_runs(tmp_path)
    assert (found.state, found.generation) == ("failed", 1 + GENERATIONS)
    assert "time step" in found.reason


def test_files_from_elsewhere_come_along(tmp_path: Path, whole: Whole) -> None:
    study = write_small(tmp_path / "a" / "small")
    data, injector = tmp_path / "evi.csv", tmp_path / "a" / "injectors" / "mine.toml"
    injector.parent.mkdir()
    (study.parent / "data" / "evi.csv").rename(data)
    (study.parent / "injector.toml").rename(injector)
    text = study.read_text(encoding="utf-8").replace('"data/evi.csv"', f'"{data}"')
    text = text.replace('"injector.toml"', '"../injectors/mine.toml"')
    study.write_text(f"allow_outside = true\n{text}", encoding="utf-8")
    run = stopped_run(tmp_path / "run", load_study(study), 4)
    shutil.rmtree(tmp_path / "a")
    data.unlink()
    moved = run.rename(tmp_path / "moved")
    resume(moved)
    assert (moved / "inputs" / "mine.toml").is_file()
    assert timeless(moved) == timeless(whole.run)


def test_a_file_changed_while_the_study_is_read(tmp_path: Path, study_file: Path) -> None:
    study = load_study(study_file)
    study_file.write_text(study.text + "\n", encoding="utf-8")
    with pytest.raises(StudyError, match=r"study\.toml: .*changed while"):
        calibrate_into(tmp_path / "run", study)


# The command, in a process that may write no longer files once three generations are kept: as on a disk without room.
NO_ROOM = """
import os, resource, sys
import commonrail.cli.fit as module
usual, log = module.stage_of, sys.argv[4] + "/journal.sqlite-wal"
def stage(p):
    if p.generation == 3:
        resource.setrlimit(resource.RLIMIT_FSIZE, (os.path.getsize(log), resource.RLIM_INFINITY))
    return usual(p)
module.stage_of = stage
from commonrail.cli.start import main
main()
"""


@pytest.mark.process
def test_a_full_disk_ends_with_3_and_keeps_what_was_done(whole: Whole, tmp_path: Path) -> None:
    run = tmp_path / "run"
    command = [sys.executable, "-c", NO_ROOM, "calibrate", str(whole.study), "--out", str(run)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 3, done.stderr
    assert "make room" in done.stderr.splitlines()[-1]
    (found,) = list_runs(run)
    assert found.generation in (3, 4)  # the log may have room for one more
    resume(run)
    assert timeless(run) == timeless(whole.run)


@pytest.mark.process
def test_sigterm_ends_in_order_and_resume_goes_on(whole: Whole, tmp_path: Path) -> None:
    run = tmp_path / "run"
    code = (
        "import os, signal, sys; from commonrail import load_study; from commonrail.runs.fit import *;"
        "stop = lambda p: os.kill(os.getpid(), signal.SIGTERM) if p.generation == 3 else None;"
        "c = calibrate_into(sys.argv[1], load_study(sys.argv[2]), threads=1, listener=Listener(stop)); print(c.status)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(run), str(whole.study)], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "interrupted"
    assert [r.state for r in list_runs(run)] == ["interrupted"]
    resume(run)
    assert timeless(run) == timeless(whole.run)
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


def test_too_many_generations_are_refused_before_anything_is_changed(whole: Whole, tmp_path: Path) -> None:
    run = Path(shutil.copytree(whole.run, tmp_path / "run"))
    with pytest.raises(ConfigurationError, match=r"generations: 1000000 .*1000000"):
        resume(run, generations=1_000_000)
    assert timeless(run) == timeless(whole.run)
    resume(run)


def test_links_in_place_of_journal_and_lock_are_refused(whole: Whole, tmp_path: Path) -> None:
    for name in ("journal.sqlite", "journal.lock"):
        run = Path(shutil.copytree(whole.run, tmp_path / name))
        elsewhere = tmp_path / f"elsewhere-{name}"
        if (run / name).exists():
            (run / name).rename(elsewhere)
        (run / name).symlink_to(elsewhere)
        before = elsewhere.read_bytes() if elsewhere.exists() else None
        with pytest.raises(OutputError, match="symbolic link"):
            resume(run, generations=1)
        assert (elsewhere.read_bytes() if elsewhere.exists() else None) == before


@pytest.mark.parametrize("column", ["trials", "costs", "statuses"])
def test_a_generation_that_lacks_trials_is_refused(whole: Whole, tmp_path: Path, column: str) -> None:
    run = Path(shutil.copytree(whole.run, tmp_path / "run"))
    with closing(sqlite3.connect(run / "journal.sqlite", isolation_level=None)) as connection:
        connection.execute(f"UPDATE generation SET {column} = x'00' WHERE number = 1")
    with pytest.raises(StudyError, match=r"journal .*damaged"):
        resume(run)


def test_one_bad_folder_costs_the_list_one_line(whole: Whole, tmp_path: Path) -> None:
    for name in ("fine", "lock", "pipe"):
        shutil.copytree(whole.run, tmp_path / name)
    (tmp_path / "lock" / "journal.lock").write_text("no database at all, but some text that is long enough")
    (tmp_path / "pipe" / "journal.sqlite").unlink()
    os.mkfifo(tmp_path / "pipe" / "journal.sqlite")
    assert [(run.folder.name, run.state) for run in list_runs(tmp_path)] == [
        ("fine", "finished"),
        ("lock", "damaged"),
        ("pipe", "damaged"),
    ]


@pytest.mark.parametrize("damage", ["empty", "gone", "truncated"])
def test_an_old_run_without_its_journal_is_left_alone(whole: Whole, tmp_path: Path, damage: str) -> None:
    run = Path(shutil.copytree(whole.run, tmp_path / "run"))
    journal = run / "journal.sqlite"
    {
        "empty": lambda: journal.write_bytes(b""),
        "gone": journal.unlink,
        "truncated": lambda: os.truncate(journal, 5000),
    }[damage]()
    before = {path: path.read_bytes() for path in run.rglob("*") if path.is_file() and "journal" not in path.name}
    with pytest.raises(CommonrailError):
        calibrate_into(run, load_study(whole.study))
    assert {path: path.read_bytes() for path in before} == before


def test_what_somebody_else_has_put_into_a_new_run_stays(
    tmp_path: Path, study_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = tmp_path / "run"

    def late(*arguments: object, **named: object) -> None:
        (run / "data" / "notes.md").write_text("mine")
        raise KeyboardInterrupt

    monkeypatch.setattr("commonrail.runs.fit.calibrate", late)
    with pytest.raises(KeyboardInterrupt):
        calibrate_into(run, load_study(study_file))
    assert [path.name for path in run.rglob("*") if path.is_file()] == ["notes.md"]


@pytest.mark.parametrize("change", [lambda text: text.replace("\n", "\r\n"), lambda text: "\ufeff" + text])
def test_a_study_of_another_editor_goes_on(tmp_path: Path, study_file: Path, change: Callable[[str], str]) -> None:
    study_file.write_bytes(change(study_file.read_text(encoding="utf-8")).encode())
    calibrate_into(tmp_path / "whole", load_study(study_file))
    run = stopped_run(tmp_path / "run", load_study(study_file), 3)
    for _ in range(2):  # the second time it is finished
        resume(run)
        assert timeless(run) == timeless(tmp_path / "whole")


def test_inputs_named_like_results_are_kept_apart(tmp_path: Path, study_file: Path) -> None:
    for old, new in (("injector.toml", "calibrated.toml"), ("data/evi.csv", "Traces.csv")):
        (study_file.parent / old).rename(study_file.parent / new)
        study_file.write_text(study_file.read_text("utf-8").replace(f'"{old}"', f'"{new}"'), encoding="utf-8")
    given = (study_file.parent / "calibrated.toml").read_bytes()
    calibrate_into(tmp_path / "run", load_study(study_file))
    assert (tmp_path / "run" / "inputs" / "calibrated.toml").read_bytes() == given
    assert (tmp_path / "run" / "inputs" / "Traces.csv").is_file()  # no file system may take it for traces.csv
    before = timeless(tmp_path / "run")
    resume(tmp_path / "run")
    assert timeless(tmp_path / "run") == before


@pytest.mark.parametrize("stage", [0, 1])
def test_a_flipped_bit_is_noticed(whole: Whole, tmp_path: Path, stage: int) -> None:
    run = Path(shutil.copytree(whole.run, tmp_path / "run"))
    with closing(sqlite3.connect(run / "journal.sqlite", isolation_level=None)) as connection:
        (numbers,) = connection.execute("SELECT arrays FROM state WHERE stage = ?", (stage,)).fetchone()
        flipped = bytes([numbers[0] ^ 1]) + numbers[1:]  # the last bit of the first number
        connection.execute("UPDATE state SET arrays = ? WHERE stage = ?", (flipped, stage))
    with pytest.raises(StudyError, match=r"journal .*damaged"):
        resume(run)


def test_the_holder_is_the_process_that_holds(stopped: Stop) -> None:
    run = stopped(2)  # by another session, whose process is not at work any more
    with Journal(run), pytest.raises(StudyError, match=f"process {os.getpid()} "):
        resume(run)


@pytest.mark.process
def test_a_reader_that_does_not_let_go_is_named(stopped: Stop, monkeypatch: pytest.MonkeyPatch) -> None:
    run = stopped(2)
    code = "import sqlite3, sys; c = sqlite3.connect(sys.argv[1], isolation_level=None)\nc.execute('BEGIN EXCLUSIVE')"
    code += "\nprint('open', flush=True)\ninput()"
    line = [sys.executable, "-c", code, str(run / "journal.sqlite")]
    with subprocess.Popen(line, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as reader:
        assert reader.stdout is not None
        reader.stdout.readline()
        monkeypatch.setattr("commonrail.runs.journal.PATIENCE", 0.2)
        with pytest.raises(StudyError, match="another program"):
            resume(run)
        reader.communicate("\n")
