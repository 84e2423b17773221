"""Calibrate a synthetic fleet, killed once and restarted once: ``python tests/robustness/fleet_trial.py``.

A fleet of 20 and one of 200 injectors, made by ``make_fleet.py``, on two workers. The larger one is ended with SIGKILL,
all its processes at once, when two fifths are done; the same command resumes it. Checked: the restart does not redo
what was finished; all end well; an injector costs the same processor time in both fleets, within 15 %. Exit status 1 if
not.
"""

from __future__ import annotations

import json
import os
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from contextlib import closing
from pathlib import Path
from typing import Any

from tools import make_fleet

SMALL, LARGE, WORKERS = 20, 200, 2
KILLED_AT = 0.4  # of the large fleet
FLAT = 0.15


def main() -> None:
    """Run the trial and print a line for each check."""
    with tempfile.TemporaryDirectory(prefix="commonrail-fleet-") as folder:
        good = _trial(Path(folder))
    sys.exit(0 if good else 1)


def _trial(folder: Path) -> bool:
    fleets = {count: make_fleet.make_fleet(folder / str(count), count) for count in (SMALL, LARGE)}
    small = _run(fleets[SMALL], folder / "small")
    run = folder / "large"
    _kill(fleets[LARGE], run)
    before = _done(run)
    large = _run(fleets[LARGE], run)
    after = _done(run)
    costs = {count: found["core_seconds"] / count for count, found in ((SMALL, small), (LARGE, large))}
    ratio = costs[LARGE] / costs[SMALL]
    checks = {
        f"killed with {len(before)} of {LARGE} done": 0 < len(before) < LARGE,
        f"restarted: {large['calibrated_now']} calibrated, none of those done before": (
            large["calibrated_now"] == LARGE - len(before) and before.items() <= after.items()
        ),
        f"{len(after)} of {LARGE} finished": len(after) == LARGE,
        f"processor time of an injector {costs[SMALL]:.3f} s of {SMALL}, {costs[LARGE]:.3f} s of {LARGE}: "
        f"{100.0 * (ratio - 1.0):+.1f} %": abs(ratio - 1.0) <= FLAT,
    }
    for text, holds in checks.items():
        print(f"{'ok' if holds else 'FAULT'} {text}")
    for count, found in ((SMALL, small), (LARGE, large)):
        print(
            f"{count} injectors: {found['after_the_first']:.2f} injectors/s with {WORKERS} workers once they were up; "
            f"{found['calibrated_now']} in {found['seconds']:.1f} s, of which the first took {found['first']:.1f} s"
        )
    size = sum(path.stat().st_size for path in run.rglob("*") if path.is_file())
    print(f"folder of {LARGE} injectors: {size / 1e6:.1f} MB, {size / LARGE / 1e3:.1f} kB an injector")
    return all(checks.values())


def _command(fleet: Path, run: Path) -> list[str]:
    return [sys.executable, "-m", "commonrail", "fleet", str(fleet), "--out", str(run), "--workers", str(WORKERS)]


def _run(fleet: Path, run: Path) -> dict[str, Any]:
    """Run to the end; what fleet.json says of time."""
    done = subprocess.run(_command(fleet, run), capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"fleet trial: exit status {done.returncode}: {done.stderr.strip()[-500:]}")
    found: dict[str, Any] = json.loads((run / "fleet.json").read_text(encoding="utf-8"))["clock"]
    return found


def _kill(fleet: Path, run: Path) -> None:
    """Start, and kill all its processes when some injectors are done."""
    process = subprocess.Popen(
        _command(fleet, run), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )
    while len(_done(run)) < KILLED_AT * LARGE:
        if process.poll() is not None:
            sys.exit("fleet trial: the fleet ended before it was killed")
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _done(run: Path) -> dict[str, str]:
    """Time at which each finished injector was finished."""
    if not (run / "fleet.sqlite").is_file():
        return {}
    with closing(sqlite3.connect(run / "fleet.sqlite")) as journal:
        try:
            return dict(journal.execute("SELECT name, ended FROM injector WHERE status = 'finished'").fetchall())
        except sqlite3.OperationalError:  # no tables yet
            return {}


if __name__ == "__main__":
    main()
