"""The command without modules and functions that only POSIX systems have, which `tests.other_systems` hides."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from commonrail.calibration.study_file import load_study
from commonrail.readers import guarded
from commonrail.runs import lock
from commonrail.runs.fit import calibrate_into
from tests.cli.conftest import run_command, small_study
from tests.test_pages import ROOT


def elsewhere(*words: object) -> subprocess.CompletedProcess[str]:
    """Run the command without POSIX."""
    command = [sys.executable, "-m", "tests.other_systems", *map(str, words)]
    paths = os.pathsep.join([str(ROOT / "src"), str(ROOT)])
    environment = os.environ | {"PYTHONPATH": paths}
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300, check=False)


@pytest.mark.process
def test_a_calibration_by_two_workers_has_the_same_bits(tmp_path: Path) -> None:
    """Lock, journal, kernel cache, signals and processes."""
    study = small_study(tmp_path / "small")
    done = elsewhere("calibrate", study, "--out", tmp_path / "run", "--workers", 2, "--no-live")
    assert done.returncode == 0, done.stderr
    calibrate_into(tmp_path / "here", load_study(study), threads=1)
    traces = [(tmp_path / name / "traces.csv").read_bytes() for name in ("run", "here")]
    assert traces[0] == traces[1]


@pytest.mark.process
def test_a_workbook_is_read_by_a_process_without_limits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    openpyxl = pytest.importorskip("openpyxl", reason="openpyxl is not installed")
    book = openpyxl.Workbook()
    for row in (["rail_pressure [MPa]", "energising_time [us]", "quantity [mm3]"], [80, 500, 20.5], [160, 500, 39.0]):
        book.active.append(row)
    book.save(tmp_path / "map.xlsx")
    monkeypatch.setattr(guarded, "_PROGRAM", f"import sys; sys.modules['resource'] = None; {guarded._PROGRAM}")
    done = run_command("inspect", tmp_path / "map.xlsx")
    assert done.status == 0, done.err
    assert "quantity map" in done.out


@pytest.mark.process
def test_the_machine_is_usable_with_a_load_that_nobody_knows() -> None:
    done = elsewhere("doctor", "--json")
    assert done.returncode == 0, done.stderr
    facts = {fact["name"]: fact["value"] for fact in json.loads(done.stdout)["facts"]}
    assert "load unknown" in facts["threads"]


def test_without_locks_of_folders_the_journal_locks_a_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lock, "fcntl", None)
    held = lock.Lock(tmp_path / "journal.lock")
    assert held.is_in_place
    with pytest.raises(BlockingIOError):
        lock.Lock(tmp_path / "journal.lock")
    held.close()
    lock.Lock(tmp_path / "journal.lock").close()


STOPPED = """
import signal
signal.SIGBREAK = signal.SIGUSR1
from commonrail.base.hooks import hold_interrupts
with hold_interrupts() as stop:
    signal.raise_signal(signal.SIGBREAK)
    print(stop.asked, stop.pressed)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="Windows has the signal itself")
def test_ctrl_break_asks_for_a_stop() -> None:
    done = subprocess.run([sys.executable, "-c", STOPPED], capture_output=True, text=True, check=False)
    assert done.stdout.split() == ["True", "False"], done.stderr


def test_an_encoding_that_lacks_a_sign_is_no_fault() -> None:
    command = [sys.executable, "-m", "commonrail", "catalogue", "parameters", "--full"]
    environment = os.environ | {"PYTHONIOENCODING": "cp1252"}
    done = subprocess.run(command, env=environment, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    assert b"nozzle.holes" in done.stdout
