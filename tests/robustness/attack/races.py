"""Attacks by time and place: files and folders that change at work, dying workers, keys pressed twice, odd clocks."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import commonrail as cr
from commonrail.base.errors import StudyError
from commonrail.calibration.study_file import load_study
from commonrail.plugins.fleet.run import fleet as run_fleet
from commonrail.plugins.fleet.study import load_fleet
from commonrail.runs.fit import calibrate_into
from commonrail.runs.journal import LOCK, Journal
from tests.robustness.attack.base import HANGS, attack, python
from tests.robustness.attack.samples import (
    after_steps,
    contents,
    edited,
    refusal,
    rows,
    small_fleet,
    small_run,
    small_study,
)


@attack(few=0)
def data_changed(folder: Path, times: int) -> str:
    """Data changed while a fleet runs are booked under the fingerprint of what was read."""
    fleet = small_fleet(folder, 3)
    data = fleet.parent / "data" / "SN000003_160MPa.csv"
    before = contents(fleet.parent)

    def change(p: object) -> None:
        if p.done == 1:  # type: ignore[attr-defined]
            data.write_text(data.read_text(encoding="utf-8") + "# measured again\n", encoding="utf-8")

    run = run_fleet(load_fleet(fleet), folder / "run", workers=1, progress=change)
    place = data.relative_to(fleet.parent).as_posix()
    if run.entries[2].inputs["160 MPa"] != contents(fleet.parent)[place]:
        was = "what it was at the start" if run.entries[2].inputs["160 MPa"] == before[place] else "something else"
        return f"booked as {was}"
    edited(data, "# measured again\n", "")
    said = refusal(lambda: run_fleet(load_fleet(fleet), folder / "run", workers=1))
    return "" if "calibrated to other data" in said else f"other data are not noticed: {said}"


@attack(few=0)
def folder_renamed(folder: Path, times: int) -> str:
    """A run folder renamed at work writes nothing into its successor, and can be resumed where it is."""
    done = small_run(folder)
    run, moved = folder / "second", folder / "moved"

    def replace() -> None:
        run.rename(moved)
        shutil.copytree(done, run)

    study = load_study(folder / "study" / "study.toml")
    said = refusal(lambda: calibrate_into(run, study, threads=1, listener=after_steps(2, replace)))
    if "renamed, moved or replaced" not in said:
        return said or "it went on"
    if contents(run) != contents(done):
        return "the successor has changed"
    cr.resume(moved, threads=1)
    same = all(contents(moved)[name] == contents(done)[name] for name in ("calibrated.toml", "traces.csv"))
    return "" if same else "resumed, it ends elsewhere"


HOLDER = """
import sys, time
from pathlib import Path
from commonrail.runs.journal import Journal
with Journal(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


@attack(times=5, few=1)
def lock_removed(folder: Path, times: int) -> str:
    """A lock file removed at work lets nobody else in, and a killed process lets go."""
    run = folder / "run"
    run.mkdir()
    for number in range(times):
        line = [sys.executable, "-c", HOLDER, str(run)]
        with subprocess.Popen(line, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as holder:
            assert holder.stdout is not None
            if holder.stdout.readline() != "held\n":
                return f"time {number}: the folder cannot be held"
            (run / LOCK).unlink()
            said = refusal(lambda: Journal(run).close())
            holder.kill()
        if "is at work here" not in said:
            return f"time {number}: {said or 'a second process was let in'}"
        try:
            Journal(run).close()
        except StudyError as error:
            return f"time {number}: {error}"
    return ""


# Ends each worker process before its first instruction.
NO_WORKERS = "import os, sys\nif '--multiprocessing-fork' in sys.orig_argv:\n    os._exit(7)\n"


@attack(few=0)
def dying_workers(folder: Path, times: int) -> str:
    """Workers that die at each start leave the fleet's table, with the reason in each row."""
    (folder / "site").mkdir()
    (folder / "site" / "sitecustomize.py").write_text(NO_WORKERS, encoding="utf-8")
    path = os.pathsep.join(filter(None, [str(folder / "site"), os.environ.get("PYTHONPATH", "")]))
    line = ["-m", "commonrail", "fleet", small_fleet(folder), "--out", folder / "run", "--workers", "1"]
    answer = python(*line, PYTHONPATH=path)
    if answer.fault or answer.status != 2:
        return answer.fault or f"exit status {answer.status}"
    table = folder / "run" / "results.csv"
    if not table.is_file():
        return "there is no table"
    reasons = [row[2] for row in rows(table) if row[0].startswith("SN")]
    return "" if len(reasons) == 2 and all("exit code 7" in reason for reason in reasons) else f"the reasons: {reasons}"


@attack(times=5, few=0)
def second_key(folder: Path, times: int) -> str:
    """A second Ctrl-C ends the command at once, and the run can be resumed."""
    study = small_study(folder / "study", generations=1_000_000)
    for number in range(times):
        run = folder / f"run-{number}"
        line = [sys.executable, "-m", "commonrail", "calibrate", str(study), "--out", str(run), "--threads", "1"]
        with subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as command:
            assert command.stderr is not None
            _wait(lambda run=run: any(r.generation > 1 for r in cr.runs.list_runs(run)) if run.is_dir() else False)  # type: ignore[misc]
            command.send_signal(signal.SIGINT)
            command.send_signal(signal.SIGINT)
            try:
                command.wait(HANGS)
            except subprocess.TimeoutExpired:
                command.kill()
                return f"time {number}: it does not end"
        if command.returncode not in (-signal.SIGINT, 130):
            return f"time {number}: exit status {command.returncode}"
        with Journal(run) as journal:
            if journal.checkpoint() is None:
                return f"time {number}: nothing is kept"
    return ""


def _wait(happened: Callable[[], bool]) -> None:
    start = time.monotonic()
    while not happened() and time.monotonic() - start < HANGS:
        time.sleep(0.05)


# A disk on which each step of Python's own takes a while, a clock that jumps to and fro by hours, and the start method
# of processes set by the caller.
ODD = """
import itertools, multiprocessing, os, sys, time
def main():
    usual, wait, jumps = time.time, time.sleep, itertools.cycle([0.0, 7200.0, -7200.0, 86400.0])
    time.time = lambda: usual() + next(jumps)
    settle = os.fsync
    os.fsync = lambda handle: (wait(0.05), settle(handle))[1]
    multiprocessing.set_start_method(sys.argv.pop(1))
    from commonrail.cli.start import main
    main()
if __name__ == "__main__":
    main()
"""


@attack(few=0)
def odd_surroundings(folder: Path, times: int) -> str:
    """A slow disk, a clock that jumps and any start method of processes change no bit of a run."""
    done = small_run(folder)
    script = folder / "odd.py"
    script.write_text(ODD, encoding="utf-8")
    for method in ("spawn", "fork", "forkserver"):
        run = folder / method
        line = ["calibrate", folder / "study" / "study.toml", "--out", run, "--workers", "1"]
        answer = python(script, method, *line)
        if answer.fault or answer.status:
            return f"{method}: {answer.fault or answer.said}"
        if any(contents(run)[name] != contents(done)[name] for name in ("calibrated.toml", "traces.csv")):
            return f"{method}: it ends elsewhere"
    return ""
