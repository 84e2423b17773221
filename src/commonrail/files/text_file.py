"""Text and TOML from disk, with one sentence for each way in which a file cannot be read."""

from __future__ import annotations

import hashlib
import os
import re
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any

from commonrail.errors import InputError, nearest

__all__ = ["noting_files", "parse_toml", "read_text", "read_toml"]

LARGEST_TOML = 10_000_000  # [bytes]; a file of settings has some thousands


_noted: ContextVar[dict[Path, str] | None] = ContextVar("_noted", default=None)


@contextmanager
def noting_files() -> Iterator[dict[Path, str]]:
    """Absolute path and SHA-256 of every file that is read inside the block, in the order of reading."""
    noted: dict[Path, str] = {}
    token = _noted.set(noted)
    try:
        yield noted
    finally:
        _noted.reset(token)


def read_text(path: Path, largest: int) -> str:
    """Text of a UTF-8 file of at most `largest` bytes, line ends as ``"\\n"``.

    Raises
    ------
    InputError
        If the file is missing, a folder, too large, not permitted, or not UTF-8 text.
    """
    if path.is_dir():
        raise InputError(f"{path}: this is a folder, and a file is expected.")
    try:
        size = path.stat().st_size
        if size > largest:
            raise InputError(
                f"{path}: the file has {size / 1e6:.0f} MB, more than the {largest / 1e6:.0f} MB "
                "that are read; keep only what is needed."
            )
        data = path.read_bytes()
    except FileNotFoundError as error:
        raise InputError(f"{path}: there is no such file{_similar(path)}.") from error
    except (OSError, ValueError) as error:  # ValueError: a null character in the name
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{path}: the file cannot be read ({reason}).") from error
    noted = _noted.get()
    if noted is not None:
        noted[Path(os.path.abspath(path))] = hashlib.sha256(data).hexdigest()
    return _decoded(path, data).replace("\r\n", "\n").replace("\r", "\n")


def _decoded(path: Path, data: bytes) -> str:
    if b"\0" in data:
        raise InputError(f"{path}: this is not a text file; save it as UTF-8 text.")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        byte = data[error.start]
        raise InputError(
            f"{path}, line {line}: byte 0x{byte:02x} is not UTF-8 text; save the file as UTF-8."
        ) from error


def _similar(path: Path) -> str:
    try:
        return nearest(path.name, sorted(entry.name for entry in path.parent.iterdir()))
    except OSError:
        return ""


def parse_toml(text: str, where: str) -> dict[str, Any]:
    """Tables of a TOML text.

    Raises
    ------
    InputError
        If it is not TOML; the message has the line.
    """
    try:
        return tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        found = re.search(r"\(at line (\d+), column \d+\)", str(error))
        line = found[1] if found else text.rstrip().count("\n") + 1
        reason = re.sub(r"\s*\(at .*", "", str(error))
        reason = reason[:1].lower() + reason[1:]
        raise InputError(
            f'{where}, line {line}: this is not TOML ({reason}); texts stand in quotes, as in key = "160 MPa".'
        ) from error


def read_toml(path: Path) -> tuple[dict[str, Any], str]:
    """Tables and text of a TOML file.

    Raises
    ------
    InputError
        If it cannot be read or is not TOML.
    """
    text = read_text(path, LARGEST_TOML)
    return parse_toml(text, str(path)), text
