"""Icon of an exported model: an injector nozzle with its needle and a spray, drawn here as a PNG."""

from __future__ import annotations

import struct
import zlib

import numpy as np
from numpy.typing import NDArray

__all__ = ["icon_png"]

SIZE = 64
INK, NEEDLE, SPRAY, PAPER = (29, 39, 51), (193, 39, 45), (0, 121, 180), (255, 255, 255)


def icon_png() -> bytes:
    """PNG of `SIZE` by `SIZE` points in true colour; the same bytes each time."""
    rows = b"".join(b"\0" + row.tobytes() for row in _drawn())
    header = struct.pack(">IIBBBBB", SIZE, SIZE, 8, 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n" + _chunk(b"IHDR", header) + _chunk(b"IDAT", zlib.compress(rows, 9)) + _chunk(b"IEND", b"")
    )


def _drawn() -> NDArray[np.uint8]:
    """Points (rows, columns, colours)."""
    y, x = np.mgrid[0:SIZE, 0:SIZE]
    across = np.abs(x - (SIZE - 1) / 2.0)
    half = np.where(y < 26, 13.0, np.clip(13.0 - 0.5 * (y - 26), 5.0, None))  # of the body, which ends in a cone
    picture = np.full((SIZE, SIZE, 3), PAPER, np.uint8)
    picture[(across <= half) & (y >= 3) & (y < 44)] = INK
    picture[(across <= half - 4.0) & (y >= 3) & (y < 40)] = PAPER
    picture[(across <= np.clip(4.0 - 0.5 * np.clip(y - 34, 0, None), 0.0, None)) & (y >= 3) & (y < 42)] = NEEDLE
    angle = np.arctan2(across, y - 42.0)
    for middle in (0.25, 0.85):
        picture[(np.abs(angle - middle) < 0.1) & (y >= 46) & (np.hypot(across, y - 42.0) < 20.0)] = SPRAY
    return picture


def _chunk(kind: bytes, content: bytes) -> bytes:
    checked = kind + content
    return struct.pack(">I", len(content)) + checked + struct.pack(">I", zlib.crc32(checked))
