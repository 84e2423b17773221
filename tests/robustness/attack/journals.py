"""Attacks on journals and result files: bits that flip, logs that are lost, counts that change, other processors."""

from __future__ import annotations

import atexit
import json
import shutil
import sqlite3
import tempfile
from collections import Counter
from collections.abc import Callable
from contextlib import closing
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from commonrail.base.errors import CommonrailError, StudyError
from commonrail.calibration.search import Progress
from commonrail.calibration.study_file import load_study
from commonrail.plugins.fleet import journal as fleet_journal
from commonrail.plugins.new.study import write_new
from commonrail.readers.injector import load_injector
from commonrail.readers.injector_writer import injector_text
from commonrail.runs.fit import Listener, calibrate_into, resume
from commonrail.runs.folder import read_run
from commonrail.runs.journal import JOURNAL, LOCK, Journal, read_about
from tests.plugins.fleet.conftest import calibrated
from tests.robustness.attack.base import attack, command, flipped
from tests.robustness.attack.samples import add_rollback, refusal

SMALL = {"members = 24": "members = 8", "generations = 30": "generations = 8"}
STOPPED = 6  # steps that were done when the run was killed
RESUMED = 20  # every so many journals that are not refused are resumed too
RESULTS = ("result.json", "calibrated.toml", "traces.csv")
VOLATILE = ("holder", "log")  # facts of who is at work


class Killed(BaseException):
    """Stand-in for the end of a process."""


class Ground(NamedTuple):
    """A run that was never stopped, and one that was killed, with its log and as one file."""

    whole: Path
    killed: Path
    merged: Path


@cache
def ground() -> Ground:
    """Runs to attack, made once; attacks are on copies."""
    folder = Path(tempfile.mkdtemp(prefix="commonrail-ground-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    write_new(folder / "study")
    path = folder / "study" / "study.toml"
    text = path.read_text(encoding="utf-8")
    for old, new in SMALL.items():
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")
    found = Ground(*(folder / name for name in Ground._fields))
    calibrate_into(found.whole, load_study(path), threads=1)

    def progress(p: Progress) -> None:
        if p.generation == STOPPED:
            shutil.copytree(found.merged, found.killed)  # as SIGKILL would leave it
            raise Killed

    try:
        calibrate_into(found.merged, load_study(path), threads=1, listener=Listener(progress))
    except Killed:
        return found
    raise AssertionError("the run was not stopped")


def results(run: Path) -> list[Any]:
    """Result files of a run but for what depends on the clock."""
    record = json.loads((run / "result.json").read_text(encoding="utf-8"))
    record.pop("clock")
    return [record, *((run / name).read_bytes() for name in RESULTS[1:])]


def content(run: Path) -> list[Any]:
    """Targets and history of a journal, all that is the same in its earlier states, and the rest that it tells."""
    listed = read_about(run)
    with Journal(run) as journal:
        about, checkpoint = journal.about, journal.checkpoint()
        steps = [(x.tolist(), costs.tolist()) for x, costs in [journal.best_step()]]
        fixed, targets = [journal.inputs, journal.generations], journal.targets
    for facts in (about, listed):
        for name in VOLATILE:
            facts.pop(name, None)
    state = about.pop("state", "")  # written with the session, after the facts of the run
    steps_so_far = list(checkpoint.history if checkpoint else ())
    return [targets, steps_so_far, [*fixed, about], [state, listed, steps, repr(checkpoint)]]


def entries(folder: Path) -> list[Any]:
    """All that the journal of a fleet tells."""
    with fleet_journal.Journal(folder) as journal:
        return [journal.about.get("content"), journal.entries()]


def told(run: Path) -> list[Any]:
    """All that is read back from the result files of a run."""
    record, traces = read_run(run)
    curves = {name: {key: values.tobytes() for key, values in curve.items()} for name, curve in traces.items()}
    return [record, curves, injector_text(load_injector(run / "calibrated.toml"), {}, "")]


REFUSED, UNCHANGED, EARLIER, WRONG, CRASH = "refused", "unchanged", "earlier state", "SILENTLY WRONG", "CRASH"


def outcome(read: Callable[[Path], list[Any]], folder: Path, expected: list[Any]) -> str:
    """Class of what reading a damaged folder gives: twice, since a crash that does not repeat is repaired."""
    for _ in range(2):
        try:
            return UNCHANGED if read(folder) == expected else WRONG
        except CommonrailError:
            return REFUSED
        except Exception as error:
            crash = f"{CRASH} ({type(error).__name__}: {error})"
    return crash


class Trial(NamedTuple):
    """Copies of a folder, one file of which is damaged, and how they are read."""

    source: Path
    file: str
    read: Callable[[Path], list[Any]]
    settle: Callable[[Path, str, int], str] = lambda folder, found, number: found

    def run(self, scratch: Path, times: int, seed: int) -> Counter[str]:
        """Number of flips that ended in each class."""
        expected = self.read(Path(shutil.copytree(self.source, scratch / "as-written", dirs_exist_ok=True)))
        whole, counts = (self.source / self.file).read_bytes(), Counter[str]()
        folder = scratch / "spoilt"
        for number, (bit, spoilt) in enumerate(flipped(whole, times, seed)):
            shutil.copytree(self.source, folder)
            (folder / self.file).write_bytes(spoilt)
            found = self.settle(folder, outcome(self.read, folder, expected), number)
            shutil.rmtree(folder)
            counts[found if found in (REFUSED, UNCHANGED, EARLIER) else f"{found}, bit {bit} of {self.file}"] += 1
        shutil.rmtree(scratch / "as-written")
        return counts


def verdict(trials: list[Trial], folder: Path, times: int) -> str:
    """Description of what fell; the number of flips in each class is printed."""
    fallen: list[str] = []
    for seed, trial in enumerate(trials, 1):
        counts = trial.run(folder, -(-times // len(trials)), seed)
        fallen += [text for text in counts if text not in (REFUSED, UNCHANGED, EARLIER)]
        figures = ", ".join(f"{counts[name]} {name}" for name in (REFUSED, UNCHANGED, EARLIER))
        print(f"      {trial.source.name}/{trial.file}: {figures}", flush=True)
    return "; ".join(fallen)


@attack(times=2000, few=24)
def run_journal(folder: Path, times: int) -> str:
    """A flipped bit in the journal of a run is found, or changes no result."""
    made = ground()
    expected = results(made.whole)
    targets, history, fixed, _ = content(Path(shutil.copytree(made.killed, folder / "read")))

    def settle(spoilt: Path, found: str, number: int) -> str:
        if found == REFUSED or found.startswith(CRASH):
            return found
        if found == WRONG:
            sessions, kept, same, _ = content(spoilt)
            known = sessions == targets[: len(sessions)] and len(sessions) >= bool(kept)
            prefix = known and kept == history[: len(kept)]
            found = EARLIER if prefix and same == fixed else WRONG
        if number % RESUMED and found != WRONG:
            return found
        try:
            resume(spoilt, threads=1)
        except CommonrailError:
            return REFUSED
        return found if results(spoilt) == expected and found != WRONG else WRONG

    trials = [Trial(made.merged, JOURNAL, content, settle)]
    trials += [Trial(made.killed, JOURNAL + end, content, settle) for end in ("", "-wal")]
    return verdict(trials, folder, times)


@attack(times=2000, few=24)
def fleet_journal_bits(folder: Path, times: int) -> str:
    """A flipped bit in the journal of a fleet is found, or changes no injector."""
    fleet, killed = folder / "fleet", folder / "killed-fleet"
    fleet.mkdir()
    with fleet_journal.Journal(fleet) as journal:
        journal.describe({"content": '{"seed": "1"}'})
        for number in range(12):
            values = {f"parameter {i}": 0.000257 * (1 + number) / (1 + i) for i in range(8)}
            record = calibrated(0.1 / (1 + number), **values)
            own = {"160 MPa": f"{number:064x}"}
            journal.write(fleet_journal.Entry(f"I{number}", fleet_journal.FINISHED, "", 1, own, record, 0.25))
        shutil.copytree(fleet, killed)
    every = entries(Path(shutil.copytree(fleet, folder / "all")))

    def settle(spoilt: Path, found: str, _: int) -> str:
        if not found.startswith(WRONG):
            return found
        inputs, kept = entries(spoilt)
        fewer = all(every[1].get(name) == entry for name, entry in kept.items())
        return EARLIER if fewer and (inputs == every[0] or not kept) else found

    trials = [Trial(fleet, fleet_journal.JOURNAL, entries, settle)]
    trials += [Trial(killed, fleet_journal.JOURNAL + end, entries, settle) for end in ("", "-wal")]
    return verdict(trials, folder, times)


@attack(times=2000, few=24)
def result_files(folder: Path, times: int) -> str:
    """A flipped bit in a result file is found when the file is read back."""
    whole = ground().whole
    names = [name for name in (*RESULTS, "SHA256SUMS") if (whole / name).is_file()]
    return verdict([Trial(whole, name, told) for name in names], folder, times)


@attack()
def lost_log(folder: Path, times: int) -> str:
    """A journal whose log is missing is damaged; it is no run that never was."""
    killed = ground().killed
    for change in (Path.unlink, lambda path: path.write_bytes(b"")):
        run = Path(shutil.copytree(killed, folder / "run", dirs_exist_ok=True))
        change(run / f"{JOURNAL}-wal")
        for read in (read_about, resume, resume):
            try:
                read(run)
            except StudyError as error:
                if "-wal is missing" not in str(error):
                    return str(error)
            else:
                return f"{read.__name__} goes on without a word"
    return ""


@attack(few=0)
def foreign_rollback(folder: Path, times: int) -> str:
    """A rollback journal beside a journal or a lock deletes no file."""
    for name in (JOURNAL, LOCK):
        run = Path(shutil.copytree(ground().merged, folder / name))
        if name == LOCK:
            shutil.copy(run / JOURNAL, run / LOCK)
        victim = folder / f"victim of {name}"
        victim.write_text("precious", encoding="utf-8")
        add_rollback(run / name, victim)
        said = refusal(lambda run=run: resume(run, threads=1))  # type: ignore[misc]
        if not (said and victim.is_file()):
            return f"{name}: {said or 'it is taken'}{'' if victim.is_file() else ', and a file is deleted'}"
    return ""


@attack()
def changed_count(folder: Path, times: int) -> str:
    """A changed number of generations is not run."""
    for row in ("UPDATE about SET text = '9' WHERE name = 'generations'", "UPDATE generation SET simulations = 9"):
        run = Path(shutil.copytree(ground().merged, folder / "run", dirs_exist_ok=True))
        with closing(sqlite3.connect(run / JOURNAL)) as connection, connection:
            connection.execute(row)
        try:
            resume(run, threads=1)
        except StudyError:
            continue
        return f"{row} is run"
    return ""


@attack(few=0)
def another_processor(folder: Path, times: int) -> str:
    """A run that goes on with another target of the compiler says so, and its result does."""
    run = Path(shutil.copytree(ground().merged, folder / "run"))
    answer = command("resume", run, NUMBA_CPU_NAME="generic")
    said = " ".join(answer.said.split())
    if answer.fault or answer.status != 0:
        return answer.fault or said
    warnings = json.loads((run / "result.json").read_text(encoding="utf-8"))["warnings"]
    if not any(w["code"] == "target" and "now generic" in w["sentence"] for w in warnings):
        return "result.json does not say it"
    if "now generic" not in said:
        return f"resume does not say it: {said}"
    again = command("resume", run).said  # here again: a session between was elsewhere
    return "" if "cpu generic, now" in " ".join(again.split()) else "the session between is forgotten"
