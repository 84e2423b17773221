"""Calibrate on disks that are too small, and resume elsewhere.

    python -m tests.robustness.no_room      # needs leave to mount

For disks (tmpfs) of growing size the paper's study is calibrated until one is large enough. Each time that it is not,
the command must end with exit status 3 and one sentence, the journal must be whole, and a copy of the folder on another
disk must end with the result of a run that was never stopped. Then a disk that may not be written to at all. Exit
status 1 if anything is not so, 77 if nothing may be mounted here.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.robustness import soak

SIZES = (60, 100, 130, 180, 250, 330, 400, 500, 560, 620, 700, 2000, 5500, 12000)  # [kB]
SKIPPED = 77


def main() -> None:
    """Run the trial and print a line for each disk."""
    with tempfile.TemporaryDirectory(prefix="commonrail-no-room-") as folder:
        faults = _trial(Path(folder))
    sys.exit(1 if faults else 0)


def _trial(folder: Path) -> int:
    soak.finish("calibrate", str(soak.STUDY), "--out", str(folder / "whole"))
    expected = soak.timeless(folder / "whole")
    lines = []
    for size in SIZES:
        with _disk(folder / "disk", f"size={size}k"):
            lines.append(_small(folder, size, expected))
            print(lines[-1], flush=True)
    with _disk(folder / "disk", "size=9000k,ro"):
        lines.append(_read_only(folder / "disk" / "run"))
        print(lines[-1], flush=True)
    faults = sum(not line.startswith("ok") for line in lines)
    print(f"no room: {len(lines) - faults} of {len(lines)} as they should be")
    return faults


def _small(folder: Path, size: int, expected: bytes) -> str:
    run, copy = folder / "disk" / "run", folder / f"copy-{size}"
    done = soak.process("calibrate", str(soak.STUDY), "--out", str(run))
    said = done.stderr.strip().splitlines()[-1]
    if done.returncode not in (0, 3) or "Traceback" in done.stderr:
        return f"FAULT {size} kB: exit status {done.returncode}: {said}"
    kept = soak.facts(run)
    if kept is None:
        return f"ok {size} kB: exit status {done.returncode}, nothing simulated yet: {said}"
    shutil.copytree(run, copy)
    damage = soak.damage(copy)
    again = soak.process("resume", str(copy))
    if damage or again.returncode or soak.timeless(copy) != expected:
        return f"FAULT {size} kB: after {kept[0]} generations a copy does not resume: {damage} {again.stderr.strip()}"
    return f"ok {size} kB: exit status {done.returncode} after {kept[0]} generations; a copy ended as it should: {said}"


def _read_only(run: Path) -> str:
    done = soak.process("calibrate", str(soak.STUDY), "--out", str(run))
    said = done.stderr.strip().splitlines()[-1]
    return f"{'ok' if done.returncode == 3 else 'FAULT'} read-only: exit status {done.returncode}: {said}"


@contextmanager
def _disk(place: Path, options: str) -> Iterator[None]:
    place.mkdir(exist_ok=True)
    mount = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(place)]
    if not shutil.which("mount") or subprocess.run(mount, capture_output=True, check=False).returncode:
        print(f"no room: skipped, user {os.getuid()} may not mount a disk here")
        sys.exit(SKIPPED)
    try:
        yield
    finally:
        subprocess.run(["umount", str(place)], check=True)


if __name__ == "__main__":
    main()
