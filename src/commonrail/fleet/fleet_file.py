"""Fleets from TOML: a study that serves as template, and the table of the injectors with their data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from commonrail.errors import InputError, nearest
from commonrail.files.place import Place, located
from commonrail.files.study_faults import read_model
from commonrail.files.study_models import StudyModel
from commonrail.files.toml_file import read_toml
from commonrail.fleet.row_supply import RowSupply
from commonrail.fleet.supply import FileSupply, Layout, Supply
from commonrail.units import parse

__all__ = ["FORMAT", "Fleet", "Template", "load_fleet"]

FORMAT = "commonrail-fleet/1"

_KEYS = {
    "format": str,
    "title": str,
    "note": str,
    "study": str,
    "seed": int,
    "files": str,
    "rows": str,
    "dead_times": str,
    "leave_out": list,
    "columns": dict,
    "attempts": int,
    "time_limit": str,
}
_KINDS = {str: "a text in quotes", int: "a whole number", list: "a list of texts", dict: "a table of texts"}

T = TypeVar("T")


@dataclass(frozen=True)
class Template:
    """The study from which each injector's own is made.

    Attributes
    ----------
    path : Path
    text : str
        The file as given.
    document : mapping
        Its tables.
    model : StudyModel
        The same, checked.
    left_out : tuple of str
        Data sets that are not used.
    """

    path: Path
    text: str
    document: Mapping[str, Any]
    model: StudyModel
    left_out: tuple[str, ...]


@dataclass(frozen=True)
class Fleet:
    """Many injectors, each to be calibrated to its own data.

    Attributes
    ----------
    path : Path
    title, note : str
    seed : int
        With an injector's name, the seed of its search.
    template : Template
    supply : Supply
        Names of the injectors and their data.
    attempts : int
        How often an injector is tried whose worker dies or hangs.
    time_limit : float
        Time after which a worker hangs [s].
    """

    path: Path
    title: str
    note: str
    seed: int
    template: Template
    supply: Supply
    attempts: int
    time_limit: float


def load_fleet(path: str | Path) -> Fleet:
    """Read a fleet with its template and its table; the injectors' own files are read later, one by one.

    Parameters
    ----------
    path : str or Path
        TOML file; the paths in it are relative to its folder, those in its table to the table's.

    Raises
    ------
    InputError
        If a file cannot be read, a key or column is unknown, missing or of the wrong kind, an injector stands twice in
        the table, or a data set of the template has no source.
    """
    file = Path(path)
    document, at = read_toml(file)[0], Place(str(file))
    _check_keys(document, at)
    template = _template(file.parent / _get(document, "study", str, at), document, at)
    return Fleet(
        file,
        _get(document, "title", str, at),
        document.get("note", ""),
        _at_least(document, "seed", 0, at, 1),
        template,
        _supply(file.parent, template, document, at),
        _at_least(document, "attempts", 1, at, 3),
        _time_limit(document, at),
    )


def _check_keys(document: Mapping[str, Any], at: Place) -> None:
    if document.get("format") != FORMAT:
        raise (at / "format").error(f'a fleet file begins with format = "{FORMAT}"')
    at.refuse_unknown(document, _KEYS)
    for key, value in document.items():
        kind = _KEYS[key]
        if not isinstance(value, kind) or isinstance(value, bool):
            raise (at / key).error(f"this must be {_KINDS[kind]}, not {value!r}")
    inner = [*document.get("leave_out", ()), *document.get("columns", {}).values()]
    wrong = [value for value in inner if not isinstance(value, str)]
    if wrong:
        key = "columns" if wrong[0] in document.get("columns", {}).values() else "leave_out"
        raise (at / key).error(f"this must hold texts in quotes, and {wrong[0]!r} is none")


def _get(document: Mapping[str, Any], key: str, kind: type[T], at: Place) -> T:
    value = document.get(key)
    if not isinstance(value, kind) or not value:
        raise (at / key).error("this key is missing or empty; add it")
    return value


def _at_least(document: Mapping[str, Any], key: str, least: int, at: Place, default: int) -> int:
    value: int = document.get(key, default)
    if value < least:
        raise (at / key).error(f"this must be {least} or greater, not {value}")
    return value


def _time_limit(document: Mapping[str, Any], at: Place) -> float:
    seconds = parse(document.get("time_limit", "60 min"), "s", str(at / "time_limit"))
    if not seconds > 0.0:
        raise (at / "time_limit").error("this must be greater than zero")
    return seconds


def _template(path: Path, document: Mapping[str, Any], at: Place) -> Template:
    with located(at / "study"):
        tables, text = read_toml(path)
    model = read_model(tables, Place(str(path)))
    left_out = tuple(document.get("leave_out", ()))
    names = [data.name for data in model.data]
    for name in left_out:
        if name not in names:
            raise (at / "leave_out").error(f'{path} has no data set "{name}"{nearest(name, names)}')
    if not any(data.role == "fit" and data.name not in left_out for data in model.data):
        raise InputError(f"{at}: no data set of {path} with role fit is left; a fleet needs one to fit.")
    return Template(path, text, tables, model, left_out)


def _supply(folder: Path, template: Template, document: Mapping[str, Any], at: Place) -> Supply:
    files, rows, dead = (document.get(key) for key in ("files", "rows", "dead_times"))
    if (files is None) == (rows is None):
        raise at.error(
            'give either files = "injectors.csv", a row for each injector with the names of its files, or '
            'rows = "measurements.csv", in which every row is a sample and names its injector'
        )
    used = [data for data in template.model.data if data.name not in template.left_out]
    layout = Layout(tuple(used), template.left_out, document.get("columns", {}), at, template.path)
    if files is not None:
        if dead is not None:
            raise (at / "dead_times").error('this key goes with rows; with files the table has a column "… dead times"')
        with located(at / "files"):
            return FileSupply(folder / files, layout)
    with located(at / "rows"):
        return RowSupply(folder / str(rows), layout, None if dead is None else folder / dead)
