"""Beginning and end of a run in its folder: what a run has put there goes away if nothing was simulated."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from commonrail.calibration.checkpoint import CheckpointError
from commonrail.errors import CommonrailError, StudyError
from commonrail.files.atomic import PART, writing
from commonrail.files.run_folder import refuse_used
from commonrail.store.faults import trusted
from commonrail.store.journal import JOURNAL, LOCK, Input, Journal, State, read_about

__all__ = ["Copied", "begun", "ending"]

_Own = TypeVar("_Own")

_LEFT = (JOURNAL, LOCK)  # and what SQLite puts beside them


@dataclass(frozen=True)
class Copied(Generic[_Own]):
    """Files that a run reads, in its folder.

    Attributes
    ----------
    own : object
        What is run, read from the copies.
    facts : mapping of str to str
        Facts for the journal.
    inputs : sequence of Input
        The copies.
    """

    own: _Own
    facts: Mapping[str, str]
    inputs: Sequence[Input]


@contextmanager
def begun(folder: Path, copies: Sequence[str], copied: Callable[[], Copied[_Own]]) -> Iterator[tuple[Journal, _Own]]:
    """A new run's journal and what is run; nothing stays if nothing was simulated.

    Parameters
    ----------
    folder : Path
        New or empty.
    copies : sequence of str
        Names of the files that `copied` will write.
    copied : function
        Writes the copies.
    """
    existed = folder.is_dir()
    _check_free(folder)
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    with Journal(folder) as journal:
        if "content" in journal.about:
            refuse_used(folder)
        journal.describe({"copies": json.dumps(list(copies))})
        try:
            found = copied()
            journal.describe(found.facts, list(found.inputs))
            yield journal, found.own
        except BaseException:
            if journal.is_in_place and journal.checkpoint() is None:
                _remove(folder, copies, existed)
            raise


@contextmanager
def ending(journal: Journal) -> Iterator[None]:
    """Note in the journal what ended a run too early, if that can still be done."""
    try:
        yield
    except CheckpointError as error:
        raise StudyError(f"{journal.path}: {error}") from error
    except BaseException as error:
        stopped = isinstance(error, KeyboardInterrupt)
        with suppress(CommonrailError):
            journal.end_session(State.INTERRUPTED if stopped else State.FAILED, "" if stopped else str(error))
        raise


def _check_free(folder: Path) -> None:
    """Refuse a folder in use, but not what a run left that was killed before it was ready to start."""
    if not (folder / LOCK).is_file():
        refuse_used(folder)
        return
    copies: list[str] = []
    with suppress(StudyError):
        about = read_about(folder)
        with trusted(folder / JOURNAL):
            copies = [] if "content" in about else [str(name) for name in json.loads(about.get("copies", "[]"))]
    own = {folder / name for name in copies}
    files = [path for path in folder.rglob("*") if not path.is_dir()]
    if any(not (path in own or path.name.startswith(_LEFT) or path.suffix == PART) for path in files):
        refuse_used(folder)


def _remove(folder: Path, copies: Sequence[str], existed: bool) -> None:
    """Take away what a run has put into a folder, and nothing else."""
    with suppress(OSError):
        for path in [folder / name for name in copies] + [p for p in folder.iterdir() if p.name.startswith(_LEFT)]:
            path.unlink(missing_ok=True)
        for place in sorted({folder / parent for name in copies for parent in Path(name).parents[:-1]}, reverse=True):
            place.rmdir()
        if not existed:
            folder.rmdir()
