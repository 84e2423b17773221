"""Files written completely or not at all: first under a temporary name, then moved into place."""

from __future__ import annotations

import errno
import os
import re
import secrets
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path
from typing import IO, Any, Literal

from commonrail.base.errors import InputError, OutputError
from commonrail.base.hooks import check_unheld_stop, within
from commonrail.base.input import SUMS, digest, read_sums

_CONTROL = re.compile("[\x00-\x08\x0a-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069]")  # but tabs
PART = ".part"  # end of the name of a file that is being written

# Folder of the set of files being written, and each file's temporary path by final path; None to remove the file.
_set: ContextVar[tuple[Path, dict[Path, Path | None]] | None] = ContextVar("_set", default=None)


@contextmanager
def writing(path: Path, option: str = "") -> Iterator[None]:
    """Turn an operating system's error while writing into a sentence.

    `option`: option of the command line that named it. Raises `OutputError` if the disk is full, there is no
    permission, or for any other reason.
    """
    try:
        yield
    except OSError as error:
        place = f"{option}: {path}" if option else f"{path}"
        reason = error.strerror or type(error).__name__
        barred = isinstance(error, PermissionError) or error.errno == errno.EROFS
        cure = "take a place where you may write" if barred else "make room there or name another place"
        raise OutputError(f"{place} cannot be written ({reason}); {cure}.", code="not-writable", file=path) from error


@contextmanager
def replacing(path: Path, mode: Literal["w", "wb"] = "w") -> Iterator[IO[Any]]:
    """Stream to a file that takes the place of `path` at the end of the block, unless the block ends in an error.

    After a crash or on a full disk, `path` keeps its old content; after a power cut, the old or the new file, never a
    fragment. Inside `write_set` all files of the set are replaced together.

    Raises `OutputError` if it cannot be written, or `path` is a symbolic link, a device or a folder, and
    `KeyboardInterrupt` if a stop was asked for, see `check_unheld_stop`.
    """
    check_unheld_stop()
    with writing(path):
        check_target(path)
        temporary = path.with_name(f".{path.name}.{secrets.token_hex(6)}{PART}")
        # names of files need not be UTF-8
        encoded = {"encoding": "utf-8", "errors": "backslashreplace", "newline": ""}
        text: dict[str, Any] = {} if mode == "wb" else encoded
        try:
            with open(temporary, mode, opener=_create, **text) as stream:
                yield stream
                stream.flush()
                os.fsync(stream.fileno())
            joint, parts = _set.get() or (None, {})
            if joint is not None and path.is_relative_to(joint):
                if (before := parts.get(path)) is not None:
                    before.unlink()
                parts[path] = temporary
                return
            os.replace(temporary, path)
        except BaseException:
            with suppress(OSError):
                temporary.unlink()
            raise
        _sync_folder(path.parent)


def line_text(text: str) -> str:
    """Text for a line of a file, with spaces for line ends, which would begin another line, and control characters."""
    return text if text.isprintable() else _CONTROL.sub(" ", text)


def write_text(path: Path, text: str) -> None:
    """Write a text file, whole or not at all.

    Raises `OutputError` as `replacing`.
    """
    with replacing(path) as stream:
        stream.write(text)


def check_target(path: Path) -> None:
    """Refuse a place where no file should be put.

    Raises `OutputError` if it is a symbolic link, a device or a folder.
    """
    # a link in a folder that others can write to may point at anything
    if path.is_symlink():
        raise OutputError(
            f"{path}: this is a symbolic link, which is not followed; remove it or name another place.",
            code="symbolic-link",
            file=path,
        )
    if path.exists() and not path.is_file():
        kind = "a folder" if path.is_dir() else "no plain file"
        raise OutputError(f"{path}: this is {kind}; name a file.", code="not-a-file", file=path)


def _create(path: str, flags: int) -> int:
    """Create and open a file; raises an error if the path exists, so that a planted link is not followed."""
    return os.open(path, flags | os.O_EXCL, 0o666)


def _sync_folder(folder: Path) -> None:
    """Flush the renaming of a file to disk, if the system supports it."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


@contextmanager
def write_set(folder: Path, *stale: str, inputs: Mapping[str, str] = {}) -> Iterator[None]:
    """Write several files of a folder as one set: all files that the block writes below it, or none if it fails.

    They get temporary names. At the end of the block their checksums join those of the set, SHA256SUMS,
    which makes the new set valid, and then the files are moved. A crash in between leaves a folder whose files do not
    fit the checksums, which `check_sums` refuses. A nested block joins the outer one.

    `stale`: files of the former set to be removed; `inputs`: digests by name of files
    that exist already. Raises `OutputError` if a file cannot be written.
    """
    check_target(folder / SUMS)
    removed = dict.fromkeys((folder / name for name in stale), None)
    if (outer := _set.get()) is not None:
        yield
        outer[1].update({**removed, **outer[1]})
        return
    parts: dict[Path, Path | None] = {}
    try:
        with within(_set, (folder, parts)):
            yield
        parts = {**removed, **parts}
        sums: dict[str, str] = {}
        with suppress(InputError):  # damaged ones are replaced
            sums = read_sums(folder / SUMS) if (folder / SUMS).is_file() else {}
        sums |= inputs
        for place, temporary in parts.items():
            sums[place.relative_to(folder).as_posix()] = "" if temporary is None else digest(temporary)
        with replacing(folder / SUMS, "wb") as stream:
            # omit names with a line break
            lines = (f"{text}  {name}\n" for name, text in sums.items() if text and "\n" not in name)
            stream.writelines(map(os.fsencode, lines))
    except BaseException:
        with suppress(OSError):
            for temporary in filter(None, parts.values()):
                temporary.unlink()
        raise
    with writing(folder):
        for place, temporary in parts.items():
            if temporary is None:
                place.unlink(missing_ok=True)
            else:
                os.replace(temporary, place)
    _sync_folder(folder)
