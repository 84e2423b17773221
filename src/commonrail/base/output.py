"""Output that is there whole or not at all: written beside its place, then moved there."""

from __future__ import annotations

import errno
import os
import re
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, Literal

from commonrail.base.errors import OutputError
from commonrail.base.input import SUMS, digest

_CONTROL = re.compile("[\x00-\x08\x0a-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069]")  # but tabs
PART = ".part"  # end of the name of a file that is being written


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
        raise OutputError(f"{place} cannot be written ({reason}); {cure}.") from error


@contextmanager
def replacing(path: Path, mode: Literal["w", "wb"] = "w") -> Iterator[IO[Any]]:
    """Stream to a file that takes the place of `path` at the end of the block, unless the block ends in an error.

    A crash or a full disk leaves what was at `path` before; a power cut leaves that or the new file, never a part.

    Raises `OutputError` if it cannot be written, or `path` is a symbolic link, a device or a folder.
    """
    with writing(path):
        check_target(path)
        part = path.with_name(f".{path.name}.{secrets.token_hex(6)}{PART}")
        text: dict[str, Any] = {} if mode == "wb" else {"encoding": "utf-8", "newline": ""}
        try:
            with open(part, mode, opener=_create, **text) as stream:
                yield stream
                stream.flush()
                os.fsync(stream.fileno())
            os.replace(part, path)
        except BaseException:
            with suppress(OSError):
                part.unlink()
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
        raise OutputError(f"{path}: this is a symbolic link, which is not followed; remove it or name another place.")
    if path.exists() and not path.is_file():
        kind = "a folder" if path.is_dir() else "no plain file"
        raise OutputError(f"{path}: this is {kind}; name a file.")


def _create(path: str, flags: int) -> int:
    """Open a file that is not there yet: what somebody has put in its place is not followed."""
    return os.open(path, flags | os.O_EXCL, 0o666)


def _sync_folder(folder: Path) -> None:
    """See that the move is on disk too, where the system can tell."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


@contextmanager
def summed(folder: Path, *names: str) -> Iterator[None]:
    """Write files of a folder in the block; their checksums follow when all are there.

    While the files are replaced there are no checksums: those of the former files would call the new ones damaged.

    `names`: files to be read back; one that was not written has no checksum. Raises `OutputError` if the checksums
    cannot be written.
    """
    path = folder / SUMS
    with writing(path):
        check_target(path)
        path.unlink(missing_ok=True)
    yield
    written = [name for name in names if (folder / name).is_file()]
    write_text(path, "".join(f"{digest(folder / name)}  {name}\n" for name in written))
