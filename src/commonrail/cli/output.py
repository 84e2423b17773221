"""Places to write to: refused before the work rather than after it."""

from __future__ import annotations

import tempfile
from pathlib import Path

from commonrail.errors import InputError
from commonrail.files.atomic import check_target, writing

__all__ = ["check_distinct", "check_file", "check_folder", "free_run_folder", "stem_of"]


def check_file(path: Path | None, option: str) -> None:
    """Refuse a file that could not be written later.

    Raises
    ------
    InputError
        If it is a folder, its folder is missing, or it is a file that a run has written or copied.
    OutputError
        If it is a symbolic link or a device, or its folder is not writable.
    """
    if path is None:
        return
    if path.is_dir():
        raise InputError(f"{option}: {path} is a folder; name a file in it.")
    if not path.parent.is_dir():
        raise InputError(f"{option}: there is no folder {path.parent}; make it or name another.")
    check_target(path)
    if path.exists():
        from commonrail.store.own_files import refuse_file_of_run  # slow to import

        refuse_file_of_run(path, option)
    with writing(path, option):
        if path.exists():
            path.open("ab").close()
        tempfile.TemporaryFile(dir=path.parent).close()


def check_distinct(*paths: Path | None) -> None:
    """Refuse outputs of one command that would take each other's place.

    Raises
    ------
    InputError
        If two are one file.
    """
    seen: dict[Path, Path] = {}
    for path in paths:
        if path is None:
            continue
        place = path.absolute().parent.resolve() / path.name
        if place in seen:
            raise InputError(f"{path}: two outputs of one command are to be written there; name a file for each.")
        seen[place] = path


def check_folder(path: Path) -> None:
    """Refuse a folder that could not be made or written to later, without making it.

    Raises
    ------
    InputError
        If it is a file.
    OutputError
        If the nearest folder above it is not writable.
    """
    above = next(p for p in (path, *path.absolute().parents) if p.exists())
    if not above.is_dir():
        raise InputError(f"{path}: {above} is a file; name a folder.")
    with writing(path):
        tempfile.TemporaryFile(dir=above).close()


def free_run_folder(stem: str, under: Path = Path("runs")) -> Path:
    """First folder ``runs/<stem>-<n>`` that does not exist yet."""
    number = 1
    while (folder := under / f"{stem}-{number}").exists():
        number += 1
    return folder


def stem_of(source: Path) -> str:
    """Name for runs of a file: one that is called study or family says less than its folder."""
    return source.absolute().parent.name if source.stem in ("study", "family") else source.stem
