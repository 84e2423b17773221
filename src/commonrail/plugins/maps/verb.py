"""commonrail map: quantity over pressure and energising time, and its inverse."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from commonrail.base.errors import CommonrailError, InputError
from commonrail.base.output import write_text
from commonrail.base.text import count_noun
from commonrail.base.units import fits, parse
from commonrail.cli import options
from commonrail.cli.console import print_result, print_text, say
from commonrail.cli.grammar import Argument, Option, table_verb
from commonrail.plugins.maps.choices import Beyond, Several

if TYPE_CHECKING:
    from commonrail.base.arrays import Floats
    from commonrail.calibration.study import Study
    from commonrail.cli.model_name import NamedModel
    from commonrail.physics.injector import Injector
    from commonrail.plugins.maps.adjust import Adjustment
    from commonrail.plugins.maps.axes import MapAxes
    from commonrail.plugins.maps.response import Conditions
    from commonrail.plugins.maps.table import MapTable


class Bands(StrEnum):
    """Source of the bands around the map of a run."""

    DRAWS = "draws"
    """Draws of the parameters in the run."""

    NONE = "none"
    """No bands."""


INVERSE, QUANTITY = "tiEnergising", "qInjected"  # default labels
UNITS = ("pressure_unit", "quantity_unit", "time_unit")  # options of a file's units


@table_verb
def map_(
    models: Annotated[
        tuple[str, ...],
        Argument(
            metavar="MODEL",
            help="One model, or two to compare: an injector file, a name of the catalogue, or a run folder.",
        ),
    ],
    *,
    rail_pressure: Annotated[
        str | None,
        Option(help="Rail pressures, e.g. 20:180:10MPa or 20,40,80MPa. [default: 16 from 20 to 180 MPa]"),
    ] = None,
    quantity: Annotated[
        str | None,
        Option(help="Quantities of the inverse, e.g. 0,0.5,1,5mm3 or 1,2mg. [default: 18 from 0 to 80 mm3]"),
    ] = None,
    energising_time: Annotated[
        str | None,
        Option(help="Energising times; the last is the longest simulated. [default: 20 from 100 us to 2 ms]"),
    ] = None,
    axes: Annotated[
        Path | None,
        Option(
            metavar="FILE",
            help="DCM, CDFX or .table file whose first map of times gives pressures, quantities, units, label and "
            "number format; a DCM file of --out is that DCM file with new times.",
        ),
    ] = None,
    cylinder_pressure: options.CylinderPressure = None,
    return_pressure: options.ReturnPressure = None,
    time_step: Annotated[str, Option(help="Time step, e.g. 1us.")] = "1us",
    set_: options.Settings = (),
    several: Annotated[Several, Option(help="Energising time if several deliver a quantity.")] = Several.NEIGHBOURS,
    unreachable: Annotated[
        Beyond, Option(help="Rule for quantities that the longest energising time does not deliver.")
    ] = Beyond.EXTRAPOLATE,
    smooth: Annotated[
        str | None,
        Option(help="Quantity error that smoothing may cost (root mean square over the cells), e.g. 0.1mm3."),
    ] = None,
    monotone: Annotated[
        bool, Option(help="Pool quantities that fall with the energising time, and times that fall with the quantity.")
    ] = False,
    resolution: Annotated[
        tuple[str, ...],
        Option(help="Resolution of the control unit, to which values are rounded: a time or a quantity; repeatable."),
    ] = (),
    bands: Annotated[
        Bands | None,
        Option(help="Bands of 50 % and 90 % around the map of a run. [default: draws, if a map was fitted]"),
    ] = None,
    measured: Annotated[
        Path | None,
        Option(metavar="FILE", help="Measured map to compare with, in any format of inspect."),
    ] = None,
    out: Annotated[
        tuple[Path, ...],
        Option(metavar="FILE", help="File for the inverse map: .csv .xlsx .mat .json .dcm .cdfx .table; repeatable."),
    ] = (),
    quantity_out: Annotated[
        tuple[Path, ...],
        Option(metavar="FILE", help="File for the quantity map, in the same formats; repeatable."),
    ] = (),
    label: Annotated[str | None, Option(help=f"Label of the inverse map. [default: from --axes, or {INVERSE}]")] = None,
    quantity_label: Annotated[str, Option(help="Label of the quantity map.")] = QUANTITY,
    pressure_unit: Annotated[
        str | None, Option(help="Unit of pressures in files. [default: hPa in DCM and CDFX, else MPa]")
    ] = None,
    quantity_unit: Annotated[
        str | None, Option(help="Unit of quantities in files. [default: mm^3/inj in DCM and CDFX, else mm3]")
    ] = None,
    time_unit: Annotated[str | None, Option(help="Unit of energising times in files. [default: us]")] = None,
    report: Annotated[Path | None, Option(metavar="FILE.html", help="Report with heat maps and curves.")] = None,
    threads: options.Threads = None,
    json: options.Json = False,
) -> None:
    """Compute the quantity map of an injector and its inverse.

    Each cell of the inverse is simulated until it delivers its quantity within 0.01 mm3. Exceptions are listed:
    unreachable, ballistic and failed cells, and those with several energising times. The map
    of a run has bands in which measured quantities are expected, as `commonrail predict` computes them.

    \b
    Examples:
      commonrail map cri2-16 --cylinder-pressure 0.5MPa --out et.dcm --label InjVlv_tiET_MAP --report map.html
      commonrail map cri2-16 --monotone --resolution 0.4us --resolution 0.01mm3 --out et.dcm --quantity-out q.dcm
      commonrail map runs/a cri2-16 --rail-pressure 20:160:20MPa --quantity 1,2,5,10,20,50mm3 --report change.html
    """
    from commonrail.plugins.maps import table as tables
    from commonrail.plugins.maps.difference import compare_with, read_measured_map
    from commonrail.plugins.maps.ecu_file import read_axes
    from commonrail.plugins.maps.file import check_map_file, map_record, write_map_file, write_map_like
    from commonrail.plugins.maps.inverse import Rules
    from commonrail.plugins.maps.page import map_html, map_lines, map_notes, map_tables
    from commonrail.plugins.maps.response import density_at
    from commonrail.plugins.maps.run import add_bands, injection_map

    any_file = bool(out or quantity_out), "--out or --quantity-out"
    options.refuse_unused(
        {
            "label": (_have_labels(out), "a file of --out with labels (no CSV)"),
            "quantity_label": (_have_labels(quantity_out), "a file of --quantity-out with labels (no CSV)"),
            **dict.fromkeys(UNITS, any_file),
        }
    )
    for name in ("rail_pressure", "quantity", *UNITS) if axes is not None else ():
        if options.is_given(name):
            raise InputError(f"--{name.replace('_', '-')}: --axes {axes} gives axes and units; omit one of the two.")
    for path in (*out, *quantity_out):
        options.check_file(path, "--out")
        check_map_file(path)
    options.check_report(report)
    options.check_distinct(*out, *quantity_out, report)
    if len(models) > 2 or (len(models) == 2 and measured is not None):
        raise InputError("Give one or two models, or one model and --measured.")
    like = None if axes is None else read_axes(axes)
    stated = (pressure_unit, quantity_unit, time_unit)
    units = {path: tables.choose_units(path, stated, like) for path in (*out, *quantity_out)}
    label_as_read = like.label if like is not None and fits(like.unit, "s") else INVERSE
    for name in (label or label_as_read, quantity_label):
        tables.check_label(name)
    sources = options.read_models(models, set_)
    conditions = read_conditions((cylinder_pressure, return_pressure), time_step, threads, sources[0].folder)
    injector = sources[0].injector
    for model in sources:
        options.refuse_return_pressure(model.injector)
    axes_of_map = _axes(injector, conditions, (rail_pressure, quantity, energising_time), like)
    points = None if measured is None else read_measured_map(measured, density_at(injector, conditions))
    fit = None
    with _no_bands_if_refused(bands):
        fit = _fit(sources[0], bands)
    rules = Rules(several, unreachable)
    adjustment = _adjustment(smooth, monotone, resolution, density_at(injector, conditions))
    maps = {m.label: injection_map(m.injector, axes_of_map, conditions, rules, say, adjustment) for m in sources}
    first = maps[sources[0].label]
    if fit is not None:
        say("predicting the bands of its cells ...")
        with _no_bands_if_refused(bands):
            first = maps[sources[0].label] = add_bands(first, *fit)
    if like is not None and not (columns := tables.find_simulated_columns(like, conditions)).all():
        say(f"at or below the cylinder pressure {count_noun(int((~columns).sum()), 'column')} of {axes} kept as before")
    for path in out:
        table = tables.inverse_table(first, label or label_as_read, units[path])
        if like is None or axes is None or not fits(like.unit, "s"):
            write_map_file(path, [table])
        else:
            write_map_like(path, tables.complete_columns(table, like, conditions), like, axes)
    for path in quantity_out:
        write_map_file(path, [tables.quantity_table(first, quantity_label, units[path])])
    compared = None if points is None else compare_with(first, points, str(measured))
    if report is not None:
        write_text(report, map_html(maps, compared))
    if not (out or quantity_out or report or json):
        say("nothing is written: --out map.dcm writes the energising times, --report map.html shows both maps")
    print_result(
        json,
        lambda: map_record(maps, compared),
        lambda: print_text(map_lines(maps, compared), map_tables(maps, compared), map_notes(maps)),
        (*out, *quantity_out, report),
    )


def read_conditions(
    pressures: tuple[str | None, str | None], time_step: str, threads: int | None, run: Path | None
) -> Conditions:
    """Read conditions from the options for cylinder and return pressure; `run`: folder of the model."""
    from commonrail.plugins.maps.response import Conditions

    return Conditions(*options.read_pressures(*pressures, run), parse(time_step, "s", "--time-step"), threads)


def _have_labels(paths: Sequence[Path]) -> bool:
    return any(path.suffix.lower() != ".csv" for path in paths)


@contextmanager
def _no_bands_if_refused(bands: Bands | None) -> Iterator[None]:
    """Say why bands are missing instead of raising, unless they were asked for."""
    try:
        yield
    except CommonrailError as error:
        if bands is not None:
            raise
        say(f"no bands: {error}")


def _fit(model: NamedModel, bands: Bands | None) -> tuple[Study, dict[str, float], Floats | None] | None:
    """Study, best values and draws (m, d) of the run whose bands are shown; None without bands."""
    if bands is Bands.NONE or (bands is None and model.run is None):
        return None
    if model.run is None:
        raise InputError(f"--bands: {model.text} is not a calibrated run folder, and only a fit has bands.")
    from commonrail.runs.folder import read_draws, read_fit

    study, best = read_fit(model.run)
    return study, best, read_draws(model.run, study.space.names)


def _axes(
    injector: Injector, conditions: Conditions, texts: tuple[str | None, str | None, str | None], like: MapTable | None
) -> MapAxes:
    """Read axes: those of the command line, else of a map in a file, else of a control unit."""
    from commonrail.plugins.maps.axes import MapAxes
    from commonrail.plugins.maps.response import density_at
    from commonrail.plugins.maps.run import usual_axes
    from commonrail.plugins.maps.table import convert_axes, find_simulated_columns

    usual = usual_axes(injector)
    pressure, quantity = usual.rail_pressure, usual.quantity
    time = usual.energising_time
    density = density_at(injector, conditions)
    if like is not None:
        pressure, quantity = convert_axes(like, density)
        pressure = pressure[find_simulated_columns(like, conditions)]
    if texts[0] is not None:
        pressure = options.read_axis(texts[0], "Pa", "--rail-pressure", increasing=True)
    if texts[1] is not None:
        quantity = read_quantities(texts[1], density, "--quantity")
    if texts[2] is not None:
        time = options.read_axis(texts[2], "s", "--energising-time", increasing=True)
    return MapAxes(pressure, quantity, time)


def _adjustment(smooth: str | None, monotone: bool, resolution: Sequence[str], density: float) -> Adjustment:
    """Read the adjustment from the options; masses are divided by the reference density [kg/m³]."""
    from commonrail.plugins.maps.adjust import Adjustment

    finest: dict[str, float] = {}
    for text in resolution:
        name = "time_resolution" if _has_unit(text, "s") else "quantity_resolution"
        if name in finest:
            raise InputError(f"--resolution {text}: a {name.replace('_', ' ')} is given twice; keep one.")
        is_time = name == "time_resolution"
        finest[name] = parse(text, "s", "--resolution") if is_time else _read_quantity(text, density, "--resolution")
    largest = None if smooth is None else _read_quantity(smooth, density, "--smooth")
    return Adjustment(largest, monotone, **finest).check()


def _has_unit(text: str, kind: str) -> bool:
    number = options.NUMBER.fullmatch(text)
    return number is not None and fits(number[2], kind)


def _read_quantity(text: str, density: float, option: str) -> float:
    return parse(text, "kg", option) / density if _has_unit(text, "kg") else parse(text, "m3", option)


def read_quantities(text: str, density: float, option: str) -> Floats:
    """Read increasing quantities (n,) [m³]; masses are divided by the reference density [kg/m³]."""
    if _has_unit(re.split("[,:]", text)[-1], "kg"):
        return options.read_axis(text, "kg", option, increasing=True) / density
    return options.read_axis(text, "m3", option, increasing=True)
