"""commonrail export: the model as a C library or as an FMU."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import click

from commonrail.cli.console import print_json, say
from commonrail.cli.grammar import Argument, Option, verb
from commonrail.cli.options import Json, Settings, check_file, check_folder, refuse_unused, with_overrides

if TYPE_CHECKING:
    from commonrail.physics.injector import Injector


class Form(StrEnum):
    """Forms in which a model leaves Python."""

    LIBRARY = "library"
    FMU = "fmu"


class Names(StrEnum):
    """Names of an FMU's variables."""

    STRUCTURED = "structured"
    """energising[1].start, which importers may show as buses."""

    FLAT = "flat"
    """energising_1__start."""


@verb
def export(
    form: Annotated[Form, Argument(help="C library, or FMU for co-simulation.")],
    model: Annotated[
        str,
        Argument(
            help="Injector file, name of the catalogue, or run folder of calibrate; @VARIANT selects another variant, "
            "e.g. cri2-16@ideal,current-trace."
        ),
    ],
    *,
    out: Annotated[
        Path | None, Option(help="Folder of the library, or file of the FMU. [default: the model's name]")
    ] = None,
    platforms: Annotated[
        str | None,
        Option(help="Platforms, e.g. linux64,win64; foreign ones need zig. [default: this machine's]"),
    ] = None,
    set_: Settings = (),
    fmi: Annotated[int, Option(help="Version of the FMI standard, 2 or 3.")] = 2,
    names: Annotated[
        Names, Option(help="Names of the FMU's variables; flat names for importers that interpret dots as buses.")
    ] = Names.STRUCTURED,
    json: Json = False,
) -> None:
    """Write a model as a C library or an FMU.

    It runs without Python. The model's values are the start values; every parameter can be set at run
    time. Platforms: linux64, linux64-avx2, linux-arm64, win64, darwin-arm64; the library also wasm32.

    \b
    Examples:
      commonrail export library virtual-lino-2016 --out injector
      commonrail export fmu runs/study-1 --platforms linux64,win64 --out injector.fmu
    """
    from commonrail.cli.model_name import read_model_name
    from commonrail.plugins.export.fmu import check_fmi
    from commonrail.plugins.export.run import export as write
    from commonrail.plugins.export.run import find_targets

    source = read_model_name(model)
    injector = with_overrides(source.injector, set_)
    targets = find_targets(None if platforms is None else platforms.split(","))
    place = out or Path(source.label.replace("/", "-") + (".fmu" if form is Form.FMU else ""))
    refuse_unused({"names": (form is Form.FMU, "an FMU"), "fmi": (form is Form.FMU, "an FMU")})
    if form is Form.FMU:
        check_fmi(fmi)
        check_file(place, "--out")
    else:
        check_folder(place)
    platform_names = [target.name for target in targets]
    written = write(injector, place, form.value, platforms=platform_names, fmi=fmi, flat=names is Names.FLAT)
    if json:
        record = {"kind": "export", "form": form.value, "out": str(place), "platforms": platform_names}
        print_json(record | {"files": list(written)})
        return
    for line in written:
        click.echo(line)
    say(f"{place}: {_next(form, injector)}")


def _next(form: Form, injector: Injector) -> str:
    """Next step, with the inputs that other variants read."""
    from commonrail.physics.variants import DRIVE, RAIL, reader_of, unread_inputs

    if form is Form.LIBRARY:
        return "the header and the examples in C, C++, Python and Julia show how to use the library"
    courses = {RAIL: "a rail pressure over time", DRIVE: "a measured current or voltage"}
    missing = unread_inputs(injector.variant)
    unread = ", ".join(f"{what} with {reader_of(name)}" for name, what in courses.items() if name in missing)
    others = f"; read by other variants only: {unread}" if unread else ""
    return f"{injector.name} with its values as start values; inputs are in SI units{others}"
