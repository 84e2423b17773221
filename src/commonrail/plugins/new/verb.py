"""commonrail new: write an example study, a study of data files, or a plug-in."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from importlib import resources
from importlib.util import find_spec
from keyword import iskeyword
from pathlib import Path
from shlex import quote
from string import Template
from typing import TYPE_CHECKING, Annotated

import click

from commonrail.base import registry
from commonrail.base.errors import InputError
from commonrail.cli.console import print_json, print_pairs
from commonrail.cli.grammar import Argument, Option, table_verb
from commonrail.cli.options import DecimalSign, Encoding, Json, SheetName, check_folder, read_form

if TYPE_CHECKING:
    from commonrail.plugins.new.study import Started, StatedByUser

# Facts that the user states for files that lack them.
BenchCylinderPressure = Annotated[str, Option(help="Cylinder pressure of the bench, e.g. 5MPa.")]
BenchReturnPressure = Annotated[str, Option(help="Pressure at the end of the return line, e.g. 0.5MPa.")]
RateRailPressure = Annotated[str, Option(help="Rail pressure of rates whose files do not state it.")]
RateEnergisingTime = Annotated[str, Option(help="Energising time of rates whose files do not state it.")]
PressureUnit = Annotated[str, Option(help="Unit of rail pressures of maps that state none.")]
TimeUnit = Annotated[str, Option(help="Unit of energising times of maps that state none.")]
QuantityUnit = Annotated[str, Option(help="Unit of quantities of maps that state none, e.g. mm3.")]


@table_verb
def new(
    folder: Annotated[
        Path | None, Argument(metavar="DIR", help="New or empty folder; default with --plugin: its name.")
    ] = None,
    *,
    injector: Annotated[
        str | None, Option(metavar="MODEL", help="Injector of the study: a name of the catalogue, or a file.")
    ] = None,
    from_: Annotated[
        tuple[Path, ...],
        Option("--from", metavar="FILE", help="Data file for the study, see inspect; repeatable."),
    ] = (),
    cylinder_pressure: BenchCylinderPressure = "",
    return_pressure: BenchReturnPressure = "",
    rail_pressure: RateRailPressure = "",
    energising_time: RateEnergisingTime = "",
    free: Annotated[
        tuple[str, ...], Option(metavar="NAME", help="Parameter to fit; repeatable. [default: screened by the data]")
    ] = (),
    sheet: SheetName = None,
    encoding: Encoding = None,
    decimal: DecimalSign = None,
    pressure_unit: PressureUnit = "",
    time_unit: TimeUnit = "",
    quantity_unit: QuantityUnit = "",
    plugin: Annotated[str, Option(metavar="NAME", help="Write a package with a verb and an optimiser instead.")] = "",
    json: Json = False,
) -> None:
    """Write a small study to start from.

    The example curve is synthetic. With --from the study uses your own files: maps, traces or records of shots. They
    are copied, their interpretation is reported, and a screening at their points proposes free parameters.

    \b
    Examples:
      commonrail new my-injector
      commonrail new my-study --injector cri2-16 --from map.xlsx --from rates.mf4 --cylinder-pressure 0.5MPa
      commonrail new --plugin my-plugin
    """
    if folder is None:
        if not plugin:
            raise InputError("Name a new or empty folder for the study, as in commonrail new my-injector.")
        folder = Path(plugin)
    check_folder(folder)
    pressures = {"cylinder_pressure": cylinder_pressure, "return_pressure": return_pressure}
    points = {"rail_pressure": rail_pressure, "energising_time": energising_time}
    units = pressure_unit, time_unit, quantity_unit
    of_data = any((*pressures.values(), *points.values(), *units, *free, sheet, encoding, decimal))
    if plugin:
        if from_ or injector is not None or of_data:
            raise InputError("--plugin excludes the options of a study; omit them.")
        following = f"pip install -e {quote(str(folder))}, then pytest {quote(str(folder))}, commonrail {plugin} --help"
        _say_written(write_plugin(folder, plugin), f'{following}; in a study: method = "{plugin} search"', json)
        return
    if from_ or injector is not None:
        if injector is None or not from_:
            raise InputError(
                "State both --injector and --from FILE, or neither; `commonrail catalogue` lists injectors."
            )
        from commonrail.plugins.new.study import write_study_from

        stated = read_stated(pressures, points, (encoding, decimal, sheet), units, from_)
        started = write_study_from(folder, injector, from_, stated._replace(free=free))
        if json:
            taken = {survey.path.name: survey.taken_for for survey in started.surveys}
            files = [str(path) for path in started.files]
            assumed = {"assumed": list(started.assumed), "free": list(started.free)}
            print_json({"kind": "new", "files": files, "taken for": taken, "open": list(started.open)} | assumed)
        else:
            _print(started)
        return
    if of_data:
        raise InputError("Pressures, times, units, form of the files and --free need --from; add it, or omit them.")
    from commonrail.plugins.new.study import write_new

    _say_written(write_new(folder), f"commonrail calibrate {quote(str(folder / 'study.toml'))}", json)


def _say_written(written: Sequence[Path], following: str, json: bool) -> None:
    if json:
        print_json({"kind": "new", "files": [str(path) for path in written]})
        return
    for path in written:
        click.echo(str(path))
    click.echo(f"next: {following}")


# A package with parts, from the templates next to this module: $name is the package, $module its module.

_NAME = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*")
_TEMPLATES = {
    "pyproject.toml": "pyproject.toml.txt",
    "README.md": "README.md.txt",
    "src/{}/__init__.py": "init.py.txt",
    "src/{}/verb.py": "verb.py.txt",
    "src/{}/search.py": "search.py.txt",
    "tests/test_parts.py": "test_parts.py.txt",
}


def write_plugin(folder: Path, name: str) -> list[Path]:
    """Write a package with a verb and an optimiser, and its tests, into a new or empty folder.

    Raises `InputError` if the name is not valid for a package or is already a verb, or the folder is not empty.
    """
    from commonrail.plugins.new.study import write_into

    if not _NAME.fullmatch(name):
        raise InputError(f"--plugin {name}: use small letters, digits and single hyphens, as in my-plugin.")
    if registry.find("verbs", name) is not None:
        raise InputError(f"--plugin {name}: a verb of this name exists; choose another name.")
    module = name.replace("-", "_")
    if iskeyword(module) or find_spec(module) is not None:
        raise InputError(f"--plugin {name}: this Python has a module {module}; choose another name.")
    templates = resources.files(__package__) / "plugin_template"
    texts = {
        path.format(module): Template((templates / file).read_text(encoding="utf-8")).substitute(
            name=name, module=module
        )
        for path, file in _TEMPLATES.items()
    }
    return write_into(folder, {path: text.encode() for path, text in texts.items()})


def read_stated(
    pressures: Mapping[str, str],
    points: Mapping[str, str],
    form: tuple[str | None, str | None, str | None],
    units: tuple[str, str, str],
    files: Sequence[Path],
) -> StatedByUser:
    """Values that options state for data files, as texts by keys of a study.

    Impossible pressures and times are refused (`InputError`), unusual ones noted. `form`: encoding, decimal sign,
    sheet; `units`: of rail pressures, energising times and quantities.
    """
    from commonrail.base.arguments import amount
    from commonrail.base.hooks import note
    from commonrail.base.units import to_text
    from commonrail.engine.operating_point import ENERGISING_TIMES, OTHER_PRESSURES, RAIL_PRESSURES
    from commonrail.plugins.new.study import StatedByUser
    from commonrail.readers.quantity_matrix import GivenUnits

    limits_by_key = {"energising_time": ("s", ENERGISING_TIMES), "rail_pressure": ("Pa", RAIL_PRESSURES)}
    for key, text in {**pressures, **points}.items():
        if text:
            option, (unit, limits) = f"--{key.replace('_', '-')}", limits_by_key.get(key, ("Pa", OTHER_PRESSURES))
            low, high = limits.likely
            if not low <= amount(text, unit, option, limits) <= high:
                note(f"{option}: {text} is unusual; {to_text(low, unit)} to {to_text(high, unit)} is expected.")
    return StatedByUser(pressures, points, read_form(*form, files), GivenUnits(*units))


def _print(started: Started) -> None:
    for survey in started.surveys:
        after = [("read as", survey.said), ("marked as", survey.synthetic)]
        pairs = [("taken for", survey.taken_for), *survey.facts.items(), *(pair for pair in after if pair[1])]
        print_pairs(pairs, survey.path.name)
    for path in started.files:
        click.echo(str(path))
    if started.open:
        click.echo(f"state in {started.study}: {', '.join(started.open)}")
    if started.assumed:
        click.echo(f"assumed, check: {', '.join(started.assumed)}")
    if started.free:
        click.echo(f"free, most influential first: {', '.join(started.free)}")
    click.echo(f"next: check {started.study}, then commonrail calibrate {quote(str(started.study))}")
