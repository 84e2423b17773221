"""Copies of all files that a study reads: its run folder can be moved and is independent of the originals."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from commonrail.base.errors import CommonrailError, InputError, StudyError
from commonrail.base.input import SUMS, read_plain, read_sums, sha256
from commonrail.base.output import replacing, writing
from commonrail.base.registry import find_shipped
from commonrail.readers.location import plain_lines
from commonrail.runs.folder import DRAWS, MEMBER, RESULT, STUDY, TRACES
from commonrail.runs.journal import JOURNAL, LOCK, Input, read_about, read_inputs

OUTSIDE = "inputs"  # folder for files from outside the study's folder, and for files with the name of a result
RESERVED = (STUDY, "calibrated.toml", DRAWS, RESULT, TRACES, "report.html", SUMS.lower(), JOURNAL, LOCK)
_NAMES_A_FILE = ("file", "fmu", "injector", "type", "study", "logo")  # keys of TOML files


def copy_paths(sources: Iterable[Path], main: str, results: Sequence[str] = ()) -> dict[Path, Path]:
    """Relative path of each copy in a run folder: `main` for the first file, unchanged for files below its folder.

    Other files, and files with the name of an output of the run, such as `results` (in lower case), come into the
    folder `OUTSIDE`.
    """
    copies: dict[Path, Path] = {}
    for source in sources:
        if not copies:
            base, place = source.parent, Path(main)
        elif source.is_relative_to(base):
            place = source.relative_to(base)
            place = Path(OUTSIDE, place) if _is_result(place, results) else place
        else:
            place = Path(OUTSIDE, source.name)
        while place in copies.values():
            place = place.with_name(f"{place.stem}-2{place.suffix}")
        copies[source] = place
    return copies


def _is_reserved(name: str) -> bool:
    return name in RESERVED or name in find_shipped("openings")


def _is_result(place: Path, results: Sequence[str]) -> bool:
    name = place.as_posix().lower()
    return _is_reserved(name) or any(fnmatchcase(name, pattern) for pattern in (MEMBER.format("*"), *results))


def copy_files(
    sources: Mapping[Path, str], folder: Path, places: Mapping[Path, Path], text: str
) -> tuple[list[Input], str]:
    """Copy files of known SHA-256 to their places; paths in the copies are updated to the new places.

    The first file has the content `text`; the text of its copy is also returned. `StudyError` if a file has changed
    since it was read, `OutputError` if a copy cannot be written.
    """
    copied: list[Input] = []
    for source, digest in sources.items():
        content = read_plain(source)
        if sha256(content) != digest:
            raise StudyError(f"{source}: the file was changed while the study was read; start again.")
        if not copied and text != plain_lines(content).decode():
            content = text.encode()
        if source.suffix == ".toml":
            content = _relocate(content, source, places)
        text = text if copied else plain_lines(content).decode()
        path = folder / places[source]
        with writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path, "wb") as stream:
            stream.write(content)
        origin = os.fsencode(source).decode("utf-8", "backslashreplace")
        copied.append(Input(places[source].as_posix(), origin, digest, sha256(content)))
    return copied, text


def _relocate(content: bytes, source: Path, places: Mapping[Path, Path]) -> bytes:
    """A TOML file whose paths lead to the copies; the same bytes if they do so already."""
    text = content.decode("utf-8-sig")
    if not _redirect(tomllib.loads(text), source, places):
        return content
    import tomlkit  # slow to import

    document = tomlkit.parse(text)
    _redirect(document, source, places)
    return tomlkit.dumps(document).encode()


def _redirect(table: Any, source: Path, places: Mapping[Path, Path]) -> bool:
    changed = False
    for key, value in list(table.items()):
        if isinstance(value, Mapping):
            changed |= _redirect(value, source, places)
        elif isinstance(value, list):
            changed |= any([_redirect(item, source, places) for item in value if isinstance(item, Mapping)])
        elif key in _NAMES_A_FILE and isinstance(value, str) and (old := _absolute(source, value)) in places:
            new = Path(os.path.relpath(places[old], places[source].parent)).as_posix()
            if new != value:
                table[key] = new
                changed = True
    return changed


def _absolute(source: Path, name: str) -> Path:
    return Path(os.path.abspath(source.parent / name))


def set_in_text(text: str, keys: tuple[str, ...], value: int | str) -> str:
    """Text of a TOML file in which the value at the path `keys` is changed or added."""
    import tomlkit  # slow to import

    document = tomlkit.parse(text)
    table: Any = document
    for key in keys[:-1]:
        if key not in table:
            table.add(key, tomlkit.table())
        table = table[key]
    table[keys[-1]] = value
    return tomlkit.dumps(document)


def study_of_run(folder: str | Path, file: str = STUDY) -> str:
    """File to edit and to calibrate again after a run: the user's file if it exists, else the copy of the run.

    `file` is the name of the copy. The copy also applies if the user's file is itself a copy in a run folder, or if the
    run changed the study (`calibrate --free`).
    """
    copy = Path(folder) / file
    with suppress(CommonrailError, OSError):
        original_text = read_about(Path(folder)).get("given")
        for item in (item for item in read_inputs(Path(folder)) if item.name == file):
            origin, is_changed = Path(item.origin), original_text and item.original != sha256(original_text.encode())
            if origin.is_file() and not (origin.parent / JOURNAL).exists() and not is_changed:
                below = origin.is_relative_to(Path.cwd())
                return (origin.relative_to(Path.cwd()) if below else origin).as_posix()
    return copy.as_posix()


# Files that belong to a run folder, and that no other output may take the place of.

DEEPEST = 4  # levels above a file at which a run folder is searched: copies of data files lie below it


def refuse_file_of_run(path: Path, option: str) -> None:
    """Refuse (`InputError`) to replace a result, the journal or a copied input of a run.

    Other files in its folder may be replaced. `option` of the command line named the file.
    """
    if not path.exists():
        return
    absolute = path.absolute()
    for folder in absolute.parents[:DEEPEST]:
        if _is_own(folder, absolute.relative_to(folder).as_posix()):
            raise InputError(f"{option}: {path} is a file of the run in {folder}; name another file.")


def _is_own(folder: Path, name: str) -> bool:
    """True for the name of a file that the run in a folder has written or copied."""
    if (folder / SUMS).is_file() and name in read_sums(folder / SUMS):
        return True
    return _is_reserved(name.lower()) and any((folder / file).is_file() for file in (SUMS, JOURNAL))
