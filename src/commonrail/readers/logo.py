"""Logo of a report, kept as text within the result so that the page needs no other file."""

from __future__ import annotations

from base64 import b64encode
from pathlib import Path

from commonrail.base.input import read_plain
from commonrail.readers.location import Place

LARGEST_LOGO = 200_000  # [bytes]
_KINDS = {b"\x89PNG\r\n\x1a\n": "image/png", b"\xff\xd8\xff": "image/jpeg", b"<svg": "image/svg+xml"}


def read_logo(path: Path, at: Place) -> str:
    """Picture as a data URI.

    It is a PNG, JPEG or SVG of at most `LARGEST_LOGO` bytes, named in the study `at` a place. Raises `InputError`
    if it cannot be read, is too large or is no such picture.
    """
    content = read_plain(path, LARGEST_LOGO)
    for opening, kind in _KINDS.items():
        if content.lstrip().startswith(opening):
            return f"data:{kind};base64,{b64encode(content).decode()}"
    raise at.error(f"{path}: this is no PNG, JPEG or SVG; save the logo as one of them")
