"""Truths of the virtual test bench from TOML: a file of the user, or those that ship with the package.

Values are written as in an injector file: a text with its unit, or an inline table that adds mark and source.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any, get_type_hints

from commonrail.analysis.bench_sensor import Sensor
from commonrail.analysis.truth import FRICTION, MASSES, QUANTITIES, Friction, Scatter, Truth
from commonrail.arguments import source_of
from commonrail.engine.reference import Resolution
from commonrail.errors import InputError, nearest
from commonrail.files.injector_file import load_injector
from commonrail.files.injector_values import Given, read_origin, read_room, read_value
from commonrail.files.place import Place, located
from commonrail.files.reach import ALLOW, Reach, read_allowed
from commonrail.files.text_file import read_text
from commonrail.files.toml_file import LARGEST_TOML, parse_toml
from commonrail.injector.definition import Injector, Source, parameter_quantities
from commonrail.injector.model import Parameters
from commonrail.injector.variants import Body, Boundary, Drive
from commonrail.parts.furniture import Q
from commonrail.units import to_text

__all__ = ["FORMAT", "load_truth", "truth_catalogue", "truth_text"]

FORMAT = "commonrail-truth/1"

_FOLDER = resources.files("commonrail.analysis") / "truths"
_KEYS = ("format", "title", ALLOW, "injector", "rail_boundary", "numerics", "values", "friction", *QUANTITIES)
_UNSTATED = Source("E", "no source stated")
_MOST_CELLS = 2000
_TIME_STEP = Q("s", "time step")


def truth_catalogue() -> list[str]:
    """Names that `load_truth` knows, sorted."""
    files = (entry.name for entry in _FOLDER.iterdir())
    return sorted(name.removesuffix(".toml") for name in files if name.endswith(".toml"))


def truth_text(source: str | Path) -> tuple[str, str]:
    """Text of a truth's file, and how to call the file in a message.

    Raises
    ------
    InputError
        If there is no such name or the file cannot be read.
    """
    source = source_of(source, "source of a truth")
    if isinstance(source, Path):
        return read_text(source, LARGEST_TOML), str(source)
    known = truth_catalogue()
    if source not in known:
        raise InputError(
            f'There is no truth "{source}" of the virtual test bench{nearest(source, known)}: choose one of '
            f"{', '.join(known)}, or give the path of a .toml file."
        )
    return (_FOLDER / f"{source}.toml").read_text(encoding="utf-8"), f"{source}.toml"


def load_truth(source: str | Path) -> Truth:
    """Read a truth of the virtual test bench.

    Parameters
    ----------
    source : str or Path
        Path of a ``.toml`` file, or a name of `truth_catalogue`.

    Returns
    -------
    Truth
        Every value in SI, with mark and source.

    Raises
    ------
    InputError
        If the file cannot be read or something in it is unknown, missing, of the wrong kind or outside its domain; the
        message has file and key.
    ConfigurationError
        If `source` is neither a name nor a path, or the truth does not fit its injector.
    """
    source = source_of(source, "source of a truth")
    text, file = truth_text(source)
    folder = source.parent if isinstance(source, Path) else None
    return _truth(parse_toml(text, file), Place(file), text, folder)


def _truth(data: Mapping[str, Any], at: Place, text: str, folder: Path | None) -> Truth:
    at.check_format(data, FORMAT)
    at.refuse_unknown(data, _KEYS)
    name = Path(at.file).stem
    injector = _injector_name(data, at, folder)
    sources: dict[str, Source] = {}
    values = _values(_table(data, "values", at), at / "values", sources)
    friction = _friction(_table(data, "friction", at), at / "friction", sources)
    chains = {key: _room(_table(data, key, at), QUANTITIES[key], at / key, sources) for key in QUANTITIES}
    truth = Truth(
        name,
        _text(data, "title", at, name),
        injector,
        values,
        _boundary(data, at),
        friction,
        _resolution(_table(data, "numerics", at), at / "numerics"),
        Sensor(**chains["rate_meter"]),
        Sensor(**chains["rail_sensor"]),
        Scatter(**chains["scatter"]),
        sources,
        text,
    )
    with located(at / "injector"):
        base = load_injector(injector)
    _check_fit(truth, base, at)
    return truth


def _injector_name(data: Mapping[str, Any], at: Place, folder: Path | None) -> str:
    """Catalogue name, or path seen from where the truth's file is."""
    if "injector" not in data:
        raise at.error('there is no injector; add injector = "virtual-lino-2016"')
    name = _text(data, "injector", at, "")
    if folder is None or not name.endswith(".toml"):
        return name
    return str(Reach(Path(at.file), read_allowed(data, at)).path(folder, name, at / "injector"))


def _boundary(data: Mapping[str, Any], at: Place) -> Boundary:
    known = [member.value for member in Boundary]
    found = _text(data, "rail_boundary", at, Boundary.VOLUME.value)
    if found not in known:
        raise (at / "rail_boundary").error(f'"{found}" is not known; write one of {", ".join(known)}')
    return Boundary(found)


def _values(table: Mapping[str, Any], at: Place, sources: dict[str, Source]) -> dict[str, float]:
    """Values of the true injector by dotted name; their sources join `sources`."""
    at.refuse_unknown(table, get_type_hints(Parameters))
    found: dict[str, float] = {}
    for room in table:
        own = {path: q for path, q in parameter_quantities().items() if path.startswith(f"{room}.")}
        quantities = {path.removeprefix(f"{room}."): q for path, q in own.items()}
        given = read_room(_table(table, room, at), quantities, at / room)
        found |= {f"{room}.{name}": item.value for name, item in given.items()}
        sources |= {f"{room}.{name}": item.source for name, item in given.items()}
    return found


def _room(
    table: Mapping[str, Any], quantities: Mapping[str, Q], at: Place, sources: dict[str, Source]
) -> dict[str, float]:
    """Values of a table by name, the ideal where none is given; sources of those given join `sources`."""
    given = read_room(table, quantities, at)
    sources |= {f"{at.key}.{name}": item.source for name, item in given.items()}
    return {name: given[name].value if name in given else float(q.default or 0.0) for name, q in quantities.items()}


def _friction(table: Mapping[str, Any], at: Place, sources: dict[str, Source]) -> Friction:
    at.refuse_unknown(table, (*FRICTION, "mark", "source"))
    origin = read_origin(table, _UNSTATED, at)
    read = {name: _nine(table[name], q, origin, at / name) for name, q in FRICTION.items() if name in table}
    sources |= {f"friction.{name}": origin for name in read}
    return Friction(**{name: tuple(item.value for item in items) for name, items in read.items()})


def _nine(item: object, q: Q, origin: Source, at: Place) -> list[Given]:
    if not isinstance(item, list) or len(item) != MASSES:
        found = f"{len(item)} values" if isinstance(item, list) else repr(item)
        raise at.error(f"this must be a list of {MASSES} values with unit, one for each mass, not {found}")
    return [read_value(value, q, origin, at[i]) for i, value in enumerate(item)]


def _resolution(table: Mapping[str, Any], at: Place) -> Resolution:
    at.refuse_unknown(table, ("feed_pipe_cells", "return_line_cells", "time_step"))
    default = Resolution((480, 120), method="explicit")
    cells = (
        _cells(table, "feed_pipe_cells", default.cells[0], at),
        _cells(table, "return_line_cells", default.cells[1], at),
    )
    step = default.step
    if "time_step" in table:
        step = read_value(table["time_step"], _TIME_STEP, _UNSTATED, at / "time_step").value
        if not 1e-9 <= step <= 1e-7:
            raise (at / "time_step").error(f"the time step must lie between 1 ns and 100 ns, not {to_text(step, 's')}")
    return default._replace(cells=cells, step=step)


def _cells(table: Mapping[str, Any], key: str, default: int, at: Place) -> int:
    found = table.get(key, default)
    if isinstance(found, bool) or not isinstance(found, int) or not 10 <= found <= _MOST_CELLS:
        raise (at / key).error(f"this must be a whole number from 10 to {_MOST_CELLS}, not {found!r}")
    return found


def _check_fit(truth: Truth, injector: Injector, at: Place) -> None:
    """Refuse what the injector cannot have."""
    with located(at / "values"):
        truth.hidden(injector)
    if any(truth.friction.coulomb + truth.friction.viscous) and injector.variant.body is not Body.FLEXIBLE:
        raise (at / "friction").error(
            f"the injector {injector.name} has a rigid body, and friction acts on nine masses"
        )
    if injector.variant.drive not in (Drive.PWM, Drive.REGULATED):
        raise (at / "injector").error(
            f"{injector.name} is driven by a measured trace, and the bench has none; "
            'choose an injector with drive_kind = "pwm" or "regulated"'
        )


def _table(data: Mapping[str, Any], key: str, at: Place) -> Mapping[str, Any]:
    found = data.get(key, {})
    if not isinstance(found, dict):
        raise (at / key).error(f"this must be a table, written [{(at / key).key}]")
    return found


def _text(data: Mapping[str, Any], key: str, at: Place, default: str) -> str:
    found = data.get(key, default)
    if not isinstance(found, str) or not found:
        raise (at / key).error("this must be a text in quotes")
    return found
