"""Injectors that were read and checked before: the next start needs neither the checks nor Pydantic.

They are kept beside the compiled kernels, whose folder stands for the physics. The name of a kept one stands for the
text, for all other sources that decide over what a text means, and for the fuels of the catalogue.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from commonrail.fuel.fuel import Fuel, Law, Origin
from commonrail.injector.definition import Injector, Source
from commonrail.injector.variants import Variant
from commonrail.kernel_cache import cache_folder, read, write

__all__ = ["DECIDING", "find", "keep"]

ENDING = ".injector"
MOST = 64  # kept injectors; beyond, the oldest are removed
MOST_NEW = 8  # kept by one process: a fleet's thousands are read once
# Sources that decide over what a text means, beside those of the physics.
DECIDING: tuple[str, ...] = (
    "arguments",
    "choices",
    "elementary",
    "errors",
    "unit_table",
    "units",
    "files.catalogue",
    "files.checked",
)
DECIDING += ("files.drawing", "files.fuel_file", "files.injector_file", "files.injector_model", "files.meter_models")
DECIDING += ("observation.low_pass", "observation.meter", "observation.quantities", "reading.faults", "reading.fields")
DECIDING += ("reading.formulas", "reading.guarded_file", "reading.place", "reading.reach", "reading.text_file")
DECIDING += ("reading.toml_file",)
_LAWS = ("density_law", "bulk_modulus_law", "isentropic_law", "viscosity_law", "vapour_law")

_new = 0


def find(text: str, stem: str) -> Injector | None:
    """Injector of a text that was read before; None where there is none.

    Parameters
    ----------
    text : str
        Of the injector's file.
    stem : str
        Name that the injector has if the text gives none.
    """
    folder = cache_folder()
    payload = None if folder is None else read(folder / _name(text, stem))[0]
    return None if payload is None else _injector(json.loads(payload))


def keep(text: str, stem: str, injector: Injector) -> None:
    """Keep an injector that a text describes, as far as there is room.

    Parameters
    ----------
    text, stem : str
        As for `find`.
    injector : Injector
        That was read from the text; all of it must follow from the text and the catalogue.
    """
    global _new
    folder = cache_folder()
    if folder is None or _new >= MOST_NEW:
        return
    _new += 1
    with contextlib.suppress(OSError):
        write(folder / _name(text, stem), json.dumps(_record(injector), allow_nan=False).encode())
        kept = sorted(folder.glob(f"*{ENDING}"), key=lambda path: path.stat().st_mtime)
        for path in kept[:-MOST]:
            path.unlink()


def _name(text: str, stem: str) -> str:
    return hashlib.sha256(json.dumps([_stamp(), stem, text]).encode()).hexdigest()[:24] + ENDING


@functools.cache
def _stamp() -> str:
    """Digest of the deciding sources and of the fuels of the catalogue."""
    root, digest = Path(__file__).parents[1], hashlib.sha256()
    for name in DECIDING:
        digest.update((root / f"{name.replace('.', '/')}.py").read_bytes())
    for fuel in sorted((resources.files("commonrail.fuel") / "catalogue").iterdir(), key=lambda file: file.name):
        digest.update(fuel.name.encode() + fuel.read_bytes())
    return digest.hexdigest()


def _record(injector: Injector) -> dict[str, Any]:
    fuel = {name: getattr(injector.fuel, name) for name in Fuel.__slots__}
    laws = {name: None if fuel[name] is None else _law_record(fuel[name]) for name in _LAWS}
    return {
        "name": injector.name,
        "title": injector.title,
        "values": dict(injector.values),
        "fuel": fuel | laws,
        "variant": [choice.value for choice in injector.variant],
        "sources": dict(injector.sources),
        "synthetic": injector.synthetic,
    }


def _law_record(law: Law) -> list[Any]:
    return [law.coefficients, law.origin.mark, law.origin.source, law.origin.error]


def _injector(record: Mapping[str, Any]) -> Injector:
    fuel = dict(record["fuel"])
    ranges = {name: tuple(fuel[name]) for name in ("pressure_range", "temperature_range")}
    laws = {name: None if fuel[name] is None else _law(*fuel[name]) for name in _LAWS}
    return Injector(
        record["name"],
        record["title"],
        record["values"],
        Fuel(**fuel | ranges | laws),
        Variant(*record["variant"]),
        {path: Source(*source) for path, source in record["sources"].items()},
        synthetic=record["synthetic"],
    )


def _law(coefficients: list[list[float]], *origin: Any) -> Law:
    return Law(tuple(map(tuple, coefficients)), Origin(*origin))
