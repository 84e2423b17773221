"""Checksums of result files, in a file ``SHA256SUMS`` beside them that ``sha256sum -c SHA256SUMS`` reads too."""

from __future__ import annotations

import hashlib
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from commonrail.errors import InputError
from commonrail.files.atomic import check_target, write_text, writing
from commonrail.reading.guarded_file import opened, read_plain

__all__ = ["SUMS", "check_sum", "listed", "summed"]

SUMS = "SHA256SUMS"
_LARGEST = 100_000  # [bytes]
_LINE = re.compile("(?P<digest>[0-9a-f]{64})  (?P<name>.+)")


@contextmanager
def summed(folder: Path, *names: str) -> Iterator[None]:
    """Write files of a folder in the block; their checksums follow when all are there.

    While the files are replaced there are no checksums: those of the former files would call the new ones damaged.

    Parameters
    ----------
    folder : Path
    *names : str
        Files to be read back; one that was not written has no checksum.

    Raises
    ------
    OutputError
        If the checksums cannot be written.
    """
    path = folder / SUMS
    with writing(path):
        check_target(path)
        path.unlink(missing_ok=True)
    yield
    written = [name for name in names if (folder / name).is_file()]
    write_text(path, "".join(f"{_digest(folder / name)}  {name}\n" for name in written))


def check_sum(path: Path) -> None:
    """Refuse a file that is not the one that was written, as far as there is a checksum beside it.

    Raises
    ------
    InputError
        If the checksums list the file with another digest, or cannot be read.
    """
    sums = path.parent / SUMS
    if not (sums.is_file() and path.is_file()):
        return
    if listed(sums).get(path.name, "") not in ("", _digest(path)):
        raise InputError(
            f"{path}: this is not the file that was written: its SHA-256 is another than in {SUMS} beside it; take a "
            "copy that is whole or make it again, and if it was changed on purpose, copy it to another folder."
        )


def listed(sums: Path) -> dict[str, str]:
    """Digests in a file of checksums by the names of the files.

    Raises
    ------
    InputError
        If a line is not a digest, two spaces and a name.
    """
    found = {}
    for i, line in enumerate(read_plain(sums, _LARGEST).decode("utf-8", "replace").splitlines(), 1):
        parts = _LINE.fullmatch(line)
        if parts is None:
            raise InputError(
                f"{sums}, line {i}: expected the SHA-256 of a file, two spaces and its name; the checksums are "
                "damaged: take a copy of the run that is whole."
            )
        found[parts["name"]] = parts["digest"]
    return found


def _digest(path: Path) -> str:
    with opened(path, sys.maxsize) as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()  # type: ignore[arg-type]
