"""Kill a calibration at random instants, resume it, and check that nothing was lost.

    python -m tests.robustness.soak 200

Every round starts ``commonrail calibrate`` on a study as a process of its own and ends it with SIGKILL at a random
instant: in half of the cases once its journal holds a random number of generations, which a busy machine does not
shift, in the other half at an instant of all its usual time. ``commonrail resume`` then goes on, is killed in its turn
in every other case, and ends at last. After every kill the journal must pass SQLite's
integrity check; at the end result.json must be that of a run that was never stopped, byte for byte, but for the one key
that holds what depends on the clock. Exit status 1 if anything is not so.
"""

from __future__ import annotations

import argparse
import random
import re
import shutil
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

STUDY = Path(__file__).resolve().parents[2] / "cases" / "paper" / "study.toml"
JOURNAL, RESULT = "journal.sqlite", "result.json"
AGAIN = 0.5  # share of kills after which the resuming process is killed too
LONGEST = 300.0  # [s] for a process that is not killed


class Round(NamedTuple):
    """Result of a round: kills, runs whose journal was found whole after a kill, faults."""

    kills: int
    moments: list[str]
    faults: list[str]


class Instant(NamedTuple):
    """Instant of a kill: seconds from the start, or from when the journal holds so many generations."""

    seconds: float
    generations: int = 0


class Times(NamedTuple):
    """Of a run that is not stopped: generations in its journal, seconds from one to the next, seconds in all."""

    generations: int
    pace: float
    end: float

    def draw(self, draw: random.Random) -> Instant:
        """An instant for a kill."""
        if draw.random() < 0.5:
            return Instant(draw.uniform(0.0, self.end))
        return Instant(draw.uniform(0.0, self.pace), draw.randint(1, self.generations))


def main() -> None:
    """Run the trial and print its figures."""
    parser = argparse.ArgumentParser(description="Kill a calibration at random instants and resume it.")
    parser.add_argument("kills", type=int, help="SIGKILLs in all")
    parser.add_argument("--study", type=Path, default=STUDY)
    parser.add_argument("--seed", type=int, default=1, help="of the instants")
    parser.add_argument("--jobs", type=int, default=2, help="rounds at a time")
    parser.add_argument("--compiled", action="store_true", help="its simulation is compiled: no run beforehand")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="commonrail-soak-") as folder:
        if not options.compiled:
            finish("calibrate", str(options.study), "--out", str(Path(folder) / "warm"))
        failed = soak(options.study, options.kills, options.seed, options.jobs, Path(folder))
    sys.exit(1 if failed else 0)


def soak(study: Path, kills: int, seed: int, jobs: int, folder: Path) -> bool:
    """Rounds until there were so many kills; whether anything was not as it should be."""
    times = _times(study, [folder / f"whole-{i}" for i in range(jobs)])
    print(f"a run takes {times.end:.2f} s, {times.pace * 1e3:.1f} ms a generation", flush=True)
    expected = timeless(folder / "whole-0")
    draw = random.Random(seed)
    rounds: list[Round] = []
    with ThreadPoolExecutor(jobs) as pool:
        while (missing := kills - sum(r.kills for r in rounds)) > 0:
            seeds = [draw.getrandbits(32) for _ in range(-(-missing // 2))]
            number = len(rounds)
            plan = [(study, folder / f"run-{number + i}", times, expected, s) for i, s in enumerate(seeds)]
            rounds += pool.map(lambda arguments: _round(*arguments), plan)
    faults = [fault for r in rounds for fault in r.faults]
    moments = Counter(moment for r in rounds for moment in r.moments)
    killed = sum(r.kills for r in rounds)
    good = sum(not r.faults for r in rounds)
    for fault in faults:
        print(f"FAULT: {fault}")
    print(f"killed when it had: {', '.join(f'{name}: {n}' for name, n in sorted(moments.items()))}")
    print(f"soak: {killed} kills, {good} of {len(rounds)} runs end with the result of a run never stopped")
    return bool(faults)


def _times(study: Path, runs: list[Path]) -> Times:
    """Run to the end, as many at a time as later, and see when a journal has its first and its last generation."""
    start = time.monotonic()
    running = [_start("calibrate", str(study), "--out", str(run)) for run in runs]
    seen: list[tuple[int, float]] = []
    while any(process.poll() is None for process in running):
        found = facts(runs[0])
        if found and found[0] > (seen[-1][0] if seen else 0):
            seen.append((found[0], time.monotonic() - start))
        time.sleep(0.005)
    end = time.monotonic() - start
    whole = facts(runs[0])
    assert whole is not None
    pace = (seen[-1][1] - seen[0][1]) / whole[0] if seen else 0.0  # a busy machine may not look before all is over
    return Times(whole[0], pace, end)


def _round(study: Path, run: Path, times: Times, expected: bytes, seed: int) -> Round:
    draw = random.Random(seed)
    begin = ["calibrate", str(study), "--out", str(run)]
    kills, moments, faults = 0, [], []
    while True:
        command = ["resume", str(run)] if _begun(run) else begin
        if kills and draw.random() > AGAIN:
            break
        if not _killed(command, run, times.draw(draw)):
            break
        kills += 1
        moments.append(_moment(run, times.generations))
        faults += [f"{run.name}: {text}" for text in damage(run)]
    done = process(*(["resume", str(run)] if _begun(run) else begin))
    if done.returncode:
        faults.append(f"{run.name}: exit status {done.returncode}: {done.stderr.strip().splitlines()[-1:]}")
    elif timeless(run) != expected:
        faults.append(f"{run.name}: {RESULT} differs from that of the run never stopped")
    if not faults:
        shutil.rmtree(run)
    return Round(kills, moments, faults)


def _killed(command: list[str], run: Path, instant: Instant) -> bool:
    """Start a process and kill it; False if it had ended by itself."""
    process = _start(*command)
    while instant.generations and process.poll() is None and _generations(run) < instant.generations:
        time.sleep(0.002)
    try:
        process.wait(instant.seconds)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        return True
    return False


def _start(*arguments: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "commonrail", *arguments]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def _begun(run: Path) -> bool:
    """Return whether there is a run to resume."""
    return facts(run) is not None


def _generations(run: Path) -> int:
    """Generations in the journal of a run at work, which is not touched."""
    if not (run / JOURNAL).is_file():
        return 0
    try:
        with closing(sqlite3.connect(f"file:{run / JOURNAL}?mode=ro", uri=True)) as journal:
            return int(journal.execute("SELECT COUNT(*) FROM generation").fetchone()[0])
    except sqlite3.OperationalError:  # no tables yet
        return 0


def facts(run: Path) -> tuple[int, int] | None:
    """Generations and sessions that ended, of a run that was begun."""
    path = run / JOURNAL
    if not path.is_file():
        return None
    with closing(sqlite3.connect(path)) as journal:
        try:
            if not journal.execute("SELECT COUNT(*) FROM about WHERE name = 'content'").fetchone()[0]:
                return None
            generations = journal.execute("SELECT COUNT(*) FROM generation").fetchone()[0]
            return generations, journal.execute("SELECT COUNT(*) FROM session WHERE ended IS NOT NULL").fetchone()[0]
        except sqlite3.OperationalError:  # no tables yet
            return None


def _moment(run: Path, whole: int) -> str:
    found = facts(run)
    if found is None:
        return "not begun"
    generations, ended = found
    if ended:
        return "ended"
    return "no generation" if generations == 0 else "all generations" if generations == whole else "some generations"


def damage(run: Path) -> list[str]:
    if not (run / JOURNAL).is_file():
        return []
    with closing(sqlite3.connect(run / JOURNAL)) as journal:
        found = [row[0] for row in journal.execute("PRAGMA integrity_check")]
    return [] if found == ["ok"] else [f"integrity check: {text}" for text in found]


def timeless(run: Path) -> bytes:
    """result.json as it stands on disk, without the key that holds what depends on the clock."""
    return re.sub(rb',\n "clock": \{[^}]*\}', b"", (run / RESULT).read_bytes())


def process(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "commonrail", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=LONGEST, check=False)


def finish(*arguments: str) -> None:
    done = process(*arguments)
    if done.returncode:
        sys.exit(f"soak: {' '.join(arguments)} ended with {done.returncode}: {done.stderr.strip()}")


if __name__ == "__main__":
    main()
