"""Injectors that were read and checked before: the next start needs neither the checks nor Pydantic.

They are kept beside the compiled kernels, whose folder stands for the physics. The name of a kept one stands for the
text, for all other sources that decide over what a text means, and for the fuels of the catalogue.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from commonrail.errors import CommonrailError
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
_RANGES = ("pressure_range", "temperature_range")
# Laws of a fuel with their numbers of coefficients: the density explicit, and following from the modulus.
_EXPLICIT = {"density_law": 4, "bulk_modulus_law": 0, "isentropic_law": 4, "viscosity_law": 3, "vapour_law": 1}
_INTEGRATED = _EXPLICIT | {"density_law": 1, "bulk_modulus_law": 4}
_LAWS = tuple(_EXPLICIT)
_OTHERS = (*_RANGES, *_LAWS)

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
    folder, stamp = cache_folder(), _stamp()
    payload = None if folder is None or not stamp else read(folder / _name(stamp, text, stem))[0]
    if payload is None:
        return None
    try:
        return _injector(json.loads(payload))
    except (ArithmeticError, AttributeError, CommonrailError, LookupError, RecursionError, TypeError, ValueError):
        return None  # written by somebody else: the file itself is read, and what it says takes this one's place


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
    folder, stamp = cache_folder(), _stamp()
    if folder is None or not stamp or _new >= MOST_NEW:
        return
    _new += 1
    with contextlib.suppress(OSError):
        write(folder / _name(stamp, text, stem), json.dumps(_record(injector), allow_nan=False).encode())
        kept = sorted(folder.glob(f"*{ENDING}"), key=lambda path: path.stat().st_mtime)
        for path in kept[:-MOST]:
            path.unlink()


def _name(stamp: str, text: str, stem: str) -> str:
    return hashlib.sha256(json.dumps([stamp, stem, text]).encode()).hexdigest()[:24] + ENDING


def _stamp() -> str:
    """Digest of the deciding sources and of the fuels of the catalogue; "" once they are not those of this process.

    A package that is upgraded beneath a running process leaves it with the code of before and the sources of after:
    what one makes must not be kept under the name of the other.
    """
    return _digest() if _AT_START and _state() == _AT_START else ""


def _deciding() -> list[Path]:
    root = Path(__file__).parents[1]
    fuels = sorted((root / "fuel" / "catalogue").glob("*.toml"))
    return [*(root / f"{name.replace('.', '/')}.py" for name in DECIDING), *fuels]


def _state() -> list[tuple[str, int, int]]:
    """Name, size and time of change of each deciding file; empty where one is missing."""
    try:
        found = [(path, path.stat()) for path in _deciding()]
    except OSError:
        return []
    return [(path.name, entry.st_size, entry.st_mtime_ns) for path, entry in found]


@functools.cache
def _digest() -> str:
    digest = hashlib.sha256()
    for path in _deciding():
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()


_AT_START = _state()


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
    """Injector of a record; any of the exceptions that `find` names for one that `_record` has not made."""
    fuel: dict[str, Any] = {name: text if name in _OTHERS else _text(text) for name, text in record["fuel"].items()}
    ranges = {name: _range(*_floats(fuel[name])) for name in _RANGES}
    sizes = _EXPLICIT if fuel["bulk_modulus_law"] is None else _INTEGRATED
    if sizes is _INTEGRATED and fuel["isentropic_law"] is None:
        sizes = sizes | {"isentropic_law": 0}
    laws = {name: _law(size, *fuel[name]) if size else None for name, size in sizes.items()}
    return Injector(
        record["name"],
        record["title"],
        record["values"],
        Fuel(**fuel | ranges | laws),
        Variant(*record["variant"]),
        {path: Source(_mark(mark), _text(source)) for path, (mark, source) in record["sources"].items()},
        synthetic=record["synthetic"],
    )


def _law(size: int, coefficients: list[list[float]], mark: str, source: str, error: float) -> Law:
    if len(coefficients) != size:
        raise ValueError
    return Law(tuple(map(_floats, coefficients)), Origin(_mark(mark), _text(source), *_floats([error])))


def _range(low: float, high: float) -> tuple[float, float]:
    if not 0.0 <= low < high:
        raise ValueError
    return low, high


def _floats(values: list[float]) -> tuple[float, ...]:
    if not values or not all(type(value) is float and math.isfinite(value) for value in values):
        raise ValueError
    return tuple(values)


def _mark(value: str) -> str:
    if value not in ("M", "C", "F", "E"):
        raise ValueError
    return value


def _text(value: str) -> str:
    if not isinstance(value, str):
        raise TypeError
    return value
