"""Fingerprint of a study: equal fingerprints mean identical searches."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from enum import Enum
from typing import Any

import numpy as np

from commonrail.calibration.study import Study
from commonrail.files.injector_writer import injector_text
from commonrail.reading.guarded_file import sha256

__all__ = ["content_of", "fingerprint_of", "sha256"]


_TOLD = frozenset({"text", "files", "author", "logo"})  # fields of a study that reports tell, and that decide nothing


def content_of(study: Study) -> str:
    """SHA-256 of all that decides over a study's result but the number of generations; file names do not."""
    space = study.space
    parts = {f.name: getattr(study, f.name) for f in fields(study) if f.name not in _TOLD}
    return fingerprint_of(
        parts
        | {
            "injector": injector_text(study.injector, {}, ""),
            "space": (space.parameters, space.rows.matrix, space.rows.labels, space.products.constraints),
            "method": replace(study.method, evolution=replace(study.method.evolution, generations=0)),
        }
    )


def fingerprint_of(*values: Any) -> str:
    """SHA-256 of values as `content_of` takes them."""
    pieces: list[bytes] = []
    _add_pieces(values, pieces)
    return sha256(b"\0".join(pieces))


def _add_pieces(value: Any, pieces: list[bytes]) -> None:
    """Append a value as bytes that tell it from every other one."""
    if isinstance(value, np.ndarray):
        pieces += f"array {value.dtype} {value.shape}".encode(), np.ascontiguousarray(value).tobytes()
    elif isinstance(value, Enum):
        pieces.append(f"{type(value).__name__}.{value.name}".encode())
    elif is_dataclass(value) or isinstance(value, Mapping):
        pairs = value.items() if isinstance(value, Mapping) else _given(value)
        pieces.append(type(value).__name__.encode())
        _add_pieces(tuple(pairs), pieces)
    elif isinstance(value, tuple | list):
        pieces.append(f"list {len(value)}".encode())
        for item in value:
            _add_pieces(item, pieces)
    elif isinstance(value, str | int | float | None):
        pieces.append(repr(value).encode())
    else:
        raise TypeError(f"a study holds {type(value).__name__}, which has no place in its content")


def _given(value: Any) -> list[tuple[str, Any]]:
    """Fields of a dataclass that follow from no others."""
    return [(f.name, getattr(value, f.name)) for f in fields(value) if f.init]
