"""Truths of the virtual test bench from TOML: a file of the user, or those that ship with the package.

Values are written as in an injector file: a text with its unit, or an inline table that adds mark and source.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, PlainValidator, create_model

from commonrail.base.arguments import read_source
from commonrail.base.choices import Body, Boundary
from commonrail.base.csv_output import write_csv
from commonrail.base.errors import InputError
from commonrail.base.input import read_plain
from commonrail.base.registry import Catalogue
from commonrail.base.units import to_text
from commonrail.engine.reference import Resolution
from commonrail.physics.injector import Injector, Source
from commonrail.physics.law import Q
from commonrail.plugins.paper import TRUTH, bench
from commonrail.plugins.paper.bench import FRICTION, QUANTITIES, Curve, Friction, Scatter, Sensor, Truth, bench_curve
from commonrail.readers import toml
from commonrail.readers.injector import component_quantities, components_of, load_injector
from commonrail.readers.location import Place, Reach, located, read_text
from commonrail.readers.toml import FileModel, Number, ParameterTable, Sourced, Stated, Text, Values

_CATALOGUE = Catalogue("commonrail.plugins.paper", "truths", 'There is no truth "{}" of the virtual test bench')
_RESOLUTION = Resolution((480, 120), method="explicit")


def _cells(item: Any) -> int:
    if isinstance(item, bool) or not isinstance(item, int) or not 10 <= item <= 2000:
        raise toml.fault(f"this must be a whole number from 10 to 2000, not {item!r}")
    return item


def _step(item: Number) -> float:
    if not 1e-9 <= item.value <= 1e-7:
        raise toml.fault(f"the time step must lie between 1 ns and 100 ns, not {to_text(item.value, 's')}")
    return item.value


def _nine(item: Any) -> Any:
    if not isinstance(item, list) or len(item) != bench.MASSES:
        actual = f"{len(item)} values" if isinstance(item, list) else repr(item)
        raise toml.fault(f"this must be a list of {bench.MASSES} values with unit, one for each mass, not {actual}")
    return item


_Cells = Annotated[int, PlainValidator(_cells)]


class _Numerics(FileModel):
    feed_pipe_cells: _Cells = _RESOLUTION.cells[0]
    return_line_cells: _Cells = _RESOLUTION.cells[1]
    time_step: Annotated[float, Stated(Q("s", "time step")), AfterValidator(_step)] = _RESOLUTION.step


class _Friction(Sourced):
    coulomb: Annotated[list[Annotated[Number, Stated(FRICTION["coulomb"])]], BeforeValidator(_nine)] | None = None
    viscous: Annotated[list[Annotated[Number, Stated(FRICTION["viscous"])]], BeforeValidator(_nine)] | None = None


class _Head(FileModel):
    """Keys of a truth's file besides the tables of `QUANTITIES` and the parts of the true injector."""

    format: Literal["commonrail-truth/1"]
    title: Text | None = None
    allow_outside: bool = False
    injector: Text
    rail_boundary: Annotated[Boundary, toml.choice(Boundary)] = Boundary.VOLUME
    numerics: _Numerics = _Numerics()
    friction: _Friction = _Friction()


def _tables(quantities: Mapping[str, Mapping[str, Q]]) -> Any:
    return {
        name: (Annotated[ParameterTable, toml.Quantities(allowed)], ParameterTable())
        for name, allowed in quantities.items()
    }


_ValuesModel = create_model(
    "_ValuesModel", __base__=FileModel, **_tables({r: component_quantities(r) for r in components_of()})
)
_fields: Any = _tables(QUANTITIES) | {"values": (_ValuesModel, _ValuesModel())}
_TruthModel = create_model("_TruthModel", __base__=_Head, **_fields)


def truth_catalogue() -> list[str]:
    """Names that `load_truth` knows, sorted."""
    return _CATALOGUE.names()


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
    source = read_source(source, "source of a truth")
    if isinstance(source, Path):
        text, file, folder = read_text(source, toml.LARGEST_TOML), str(source), source.parent
    else:
        text, file, folder = _CATALOGUE.text(source), f"{source}.toml", None
    return _truth(toml.parse_toml(text, file), Place(file), text, folder)


def _truth(document: Mapping[str, Any], at: Place, text: str, folder: Path | None) -> Truth:
    model = toml.read_model(_TruthModel, document, at)
    name, injector = Path(at.file).stem, model.injector
    if folder is not None and injector.endswith(".toml"):  # seen from where the truth's file is
        injector = str(Reach(Path(at.file), model.allow_outside).path(folder, injector, at / "injector"))
    tables = dict(model)
    components = {
        component: getattr(tables["values"], component).values() for component in document.get("values", {})
    }  # in the file's order
    chains = {table: tables[table].values() for table in QUANTITIES}
    friction, numerics = model.friction, model.numerics
    forces = {name: [n.value for n in numbers] for name in FRICTION if (numbers := getattr(friction, name)) is not None}
    sources = _sources(components) | {f"friction.{name}": friction.origin() for name in forces} | _sources(chains)
    chain_values = {table: {key: entry.value for key, entry in values.items()} for table, values in chains.items()}
    truth = Truth(
        name,
        name if model.title is None else model.title,
        injector,
        {
            f"{component_name}.{key}": entry.value
            for component_name, values in components.items()
            for key, entry in values.items()
        },
        model.rail_boundary,
        Friction(**{name: tuple(values) for name, values in forces.items()}),
        _RESOLUTION._replace(cells=(numerics.feed_pipe_cells, numerics.return_line_cells), step=numerics.time_step),
        Sensor(**chain_values["rate_meter"]),
        Sensor(**chain_values["rail_sensor"]),
        Scatter(**chain_values["scatter"]),
        sources,
        text,
    )
    with located(at / "injector"):
        base = load_injector(injector)
    _check_fit(truth, base, at)
    return truth


def _sources(tables: Mapping[str, Values]) -> dict[str, Source]:
    return {f"{table}.{key}": entry.source for table, values in tables.items() for key, entry in values.items()}


def _check_fit(truth: Truth, injector: Injector, at: Place) -> None:
    """Refuse what the injector cannot have."""
    with located(at / "values"):
        truth.make_true_injector(injector)
    if any(truth.friction.coulomb + truth.friction.viscous) and injector.variant.body is not Body.FLEXIBLE:
        raise (at / "friction").error(
            f"the injector {injector.name} has a rigid body, and friction acts on nine masses"
        )
    if injector.variant.drive.is_trace:
        raise (at / "injector").error(
            f"{injector.name} is driven by a measured trace, and the bench has none; "
            'choose an injector with drive_kind = "pwm", "regulated" or "free-wheel"'
        )


# Write the curves of the virtual test bench as the data files of a case.

OWN = "# SYNTHETIC: virtual test bench of commonrail, not a measurement"  # first line of a file of the bench


def virtual_bench(folder: Path, seed: int, truth: Truth | None = None) -> list[Path]:
    """Simulate the paper's three injection curves on the virtual test bench and write them to ``folder/data``.

    The same seed, of scatter and noise, gives the same files; `truth` is `TRUTH` if left out. InputError if the
    files cannot be written, or one of them exists and is not the bench's own; SimulationError if the truth cannot be
    simulated.
    """
    truth = truth or load_truth(TRUTH)
    injector = load_injector(truth.injector)
    for pressure in bench.RAIL_PRESSURES.values():
        path = _path(folder / "data", pressure)
        if path.exists() and not read_plain(path).startswith(OWN.encode()):  # it may be a measurement
            raise InputError(
                f"{path}: this file was not made by the virtual test bench; move it or name another folder."
            )
    curves = [
        bench_curve(truth, injector, pressure, bench.ENERGISING_TIME, seed)
        for pressure in bench.RAIL_PRESSURES.values()
    ]
    try:
        (folder / "data").mkdir(parents=True, exist_ok=True)
        return [_write(folder / "data", curve, seed, truth) for curve in curves]
    except OSError as error:
        raise InputError(f"{folder}: the data cannot be written ({error.strerror}); name another folder.") from error


def _path(folder: Path, rail_pressure: float) -> Path:
    return folder / f"evi_{round(rail_pressure * 1e-6)}MPa.csv"


def _write(folder: Path, curve: Curve, seed: int, truth: Truth) -> Path:
    mpa = round(curve.rail_pressure * 1e-6)
    path = _path(folder, curve.rail_pressure)
    notes = (
        OWN.removeprefix("# "),
        f"truth {truth.name} ({' '.join(truth.title.split())}), seed {seed}",
        f"asked for: rail pressure {mpa} MPa, energising time {bench.ENERGISING_TIME * 1e6:g} us",
        "a row: mean rate over the 3 us that end at its time, and pressure at the injector's inlet at",
        "its time, each as its sensor shows it",
    )
    samples = zip(curve.time, curve.rate, curve.rail, strict=True)
    rows = ([f"{time * 1e6:.3f}", f"{rate * 1e6:.9g}", f"{rail * 1e-6:.9g}"] for time, rate, rail in samples)
    write_csv(path, notes, ["time [us]", "rate [mm3/ms]", "rail pressure [MPa]"], rows)
    return path
