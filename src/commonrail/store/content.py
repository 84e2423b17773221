"""Fingerprint of a study: equal fingerprints mean identical searches."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from enum import Enum
from typing import Any

import numpy as np

from commonrail.calibration.goal import Loss
from commonrail.calibration.study import Study
from commonrail.choices import Precision
from commonrail.files.injector_writer import injector_text
from commonrail.injector.definition import FUEL_TEMPERATURE
from commonrail.reading.guarded_file import sha256

__all__ = ["content_of", "fingerprint_of", "sha256"]


def content_of(study: Study) -> str:
    """SHA-256 of all that decides over a study's result but the number of generations; file names do not."""
    rows = study.space.rows
    parts = (
        study.title,
        study.note,
        injector_text(study.injector, {}, ""),
        study.data,
        study.space.parameters,
        (rows.matrix, rows.labels),
        replace(study.method, evolution=replace(study.method.evolution, generations=0)),
        study.seed,
        study.time_step,
    )
    # what earlier versions did not have is left out where it decides nothing
    more: tuple[Any, ...] = () if study.precision is Precision.F64 else (study.precision,)
    if study.loss is not Loss.KINDS:
        more += (study.loss,)
    if study.loss is Loss.SOFT_L1:
        more += (study.loss_scale,)
    if any(parameter.prior for parameter in study.space.parameters):
        more += (tuple(parameter.prior for parameter in study.space.parameters),)
    if study.conditions:
        more += (study.conditions,)
    if len(study.space.products):
        more += (study.space.products.constraints,)
    tolerances = tuple(getattr(data, "dead_time_tolerance", None) for data in study.data)
    if any(tolerances):
        more += (tolerances,)
    periods = tuple(getattr(data, "stroke_period", None) for data in study.data)
    if any(periods):
        more += (periods,)
    more += ("same bits",) if study.same_bits else ()
    more += ("stop when converged",) if study.method.stop_when_converged else ()
    if FUEL_TEMPERATURE in study.space.names:
        densities = [np.asarray(data.mass_density, float) for data in study.data]
        more += tuple(density for density in densities if not np.isnan(density).all())
    sisters = tuple(getattr(data, "sister", None) for data in study.data)
    if any(sisters):
        more += (sisters,)
    if study.judgement.wanted:
        more += (study.judgement,)
    if any(data.meter for data in study.data):
        more += (tuple(data.meter for data in study.data),)
    return fingerprint_of(*parts, *more)


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
        kept = () if isinstance(value, Mapping) else [f.name for f in fields(value) if not f.metadata.get("later")]
        pairs = value.items() if isinstance(value, Mapping) else ((name, getattr(value, name)) for name in kept)
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
