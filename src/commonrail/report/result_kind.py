"""Kinds of result that a folder may hold: each has one record, a JSON file whose name identifies the kind."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from jinja2 import UndefinedError

from commonrail.base import registry
from commonrail.base.errors import InputError
from commonrail.base.record import BrokenRecordError
from commonrail.data.records import Record
from commonrail.runs.folder import RESULT, read_record

_BROKEN = (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError, UndefinedError)


class ResultKind(NamedTuple):
    """Kind of result, registered in the group "results" by the name of its record file.

    Attributes
    ----------
    file : str
        Record file.
    name : str
        Key "kind" of the record.
    verb : str
        Verb that leaves it.
    page : function of (record, Path)
        HTML of its report, from the record and the folder.
    keys : tuple of str
        Keys that the record must have.
    extra : function of Path
        Makes missing files of the folder that accompany the page; returns an empty text,
        or a sentence on what it needs.
    still : function of (record, Path), optional
        The same page without what simulates in it; None where nothing does.
    """

    file: str
    name: str
    verb: str
    page: Callable[[Record, Path], str]
    keys: tuple[str, ...] = ()
    extra: Callable[[Path], str] = lambda _: ""
    still: Callable[[Record, Path], str] | None = None

    def read(self, folder: Path) -> Record:
        """Record of a folder; InputError if it cannot be read, or is of another kind or schema, or incomplete."""
        record = read_record(folder / self.file, f"commonrail {self.verb}", self.name)
        missing = [key for key in self.keys if key not in record]
        if missing:
            raise InputError(f'{folder}: {self.file} lacks "{missing[0]}"; {self.verb} again.')
        return record

    @contextmanager
    def refusing_broken(self, folder: Path) -> Iterator[None]:
        """Turn errors caused by a broken record of a folder into an `InputError`."""
        try:
            yield
        except BrokenRecordError as error:
            raise InputError(f"{folder / self.file}: {error}; {self.verb} again.") from error
        except _BROKEN as error:
            raise InputError(
                f"{folder}: {self.file} or a file beside it is incomplete ({type(error).__name__}: {error}); "
                f"{self.verb} again."
            ) from error


def kind_of(folder: Path) -> ResultKind:
    """Kind of a folder; a calibration if no record is found."""
    shipped = registry.find_shipped("results")
    entry = _first(shipped, folder) or _first(registry.find_installed("results"), folder) or shipped[RESULT]
    kind: ResultKind = entry.load()
    return kind


def _first(parts: Mapping[str, registry.Entry], folder: Path) -> registry.Entry | None:
    return next((entry for file, entry in parts.items() if (folder / file).is_file()), None)
