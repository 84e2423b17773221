"""Small studies, runs and fleets to attack."""

from __future__ import annotations

import csv
import hashlib
import struct
from collections.abc import Callable
from pathlib import Path

from commonrail.base.errors import CommonrailError
from commonrail.calibration.study_file import load_study
from commonrail.plugins.new.study import write_new
from commonrail.runs.fit import Listener, calibrate_into
from tools.make_fleet import make_fleet

LINK = '=HYPERLINK("http://127.0.0.1/","open")'

_SECTOR, _END = 512, bytes.fromhex("d9d505f920a163d7")  # of a rollback journal of SQLite
_SHORT = {"members = 24": "members = 8", "generations = 30": "generations = 3", "polish = 3": "polish = 0"}


def small_study(folder: Path, generations: int = 3) -> Path:
    """Write the study of ``commonrail new`` with a short search; returns its file."""
    write_new(folder)
    study = folder / "study.toml"
    text = study.read_text(encoding="utf-8")
    for old, new in (_SHORT | {"generations = 30": f"generations = {generations}"}).items():
        text = text.replace(old, new)
    study.write_text(text, encoding="utf-8")
    return study


def small_run(folder: Path) -> Path:
    """Calibrate that study into a run folder, on one thread."""
    calibrate_into(folder / "run", load_study(small_study(folder / "study")), threads=1)
    return folder / "run"


def small_fleet(folder: Path, count: int = 2) -> Path:
    """Make a synthetic fleet with a search of a few tenths of a second for each injector; returns its file."""
    return make_fleet(folder / "fleet", count, members=8, generations=3)


def edited(path: Path, old: str, new: str) -> None:
    """Replace a part of a file that is in it once."""
    text = path.read_text(encoding="utf-8")
    assert text.count(old) == 1, f"{old!r} is {text.count(old)} times in {path.name}"
    path.write_text(text.replace(old, new), encoding="utf-8")


def contents(folder: Path) -> dict[str, str]:
    """SHA-256 of each file below a folder."""
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def rows(path: Path) -> list[list[str]]:
    """All rows of a table as a spreadsheet divides them, its comment lines too."""
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.reader(stream))


def refusal(call: Callable[[], object]) -> str:
    """Sentence with which a call is refused, "" if it is not."""
    try:
        call()
    except CommonrailError as error:
        return str(error)
    return ""


def after_steps(count: int, deed: Callable[[], object]) -> Listener:
    """Listener that does something once, after so many steps of a run."""
    left = iter(range(count - 1))
    done: list[object] = []

    def progress(_: object) -> None:
        if next(left, None) is None and not done:
            done.append(deed())

    return Listener(progress)


def add_rollback(database: Path, victim: Path) -> None:
    """Put a rollback journal beside a database that makes SQLite delete another file."""
    content, name = database.read_bytes(), str(victim).encode()
    (page,) = struct.unpack(">H", content[16:18])
    head = _END + struct.pack(">IIIII", 0, 1, len(content) // page, _SECTOR, page)
    last = struct.pack(">I", 0x40000000 // page + 1) + name + struct.pack(">II", len(name), sum(name)) + _END
    database.with_name(f"{database.name}-journal").write_bytes(head.ljust(_SECTOR, b"\0") + last)
