"""commonrail page: one HTML page that simulates an injector in the browser while its sliders are moved."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from commonrail.base.errors import InputError
from commonrail.base.units import parse
from commonrail.cli.console import print_json, say
from commonrail.cli.grammar import Argument, Option, verb
from commonrail.cli.options import (
    CylinderPressure,
    Json,
    ReturnPressure,
    Settings,
    Threads,
    check_file,
    read_energisings,
    read_pressures,
    with_overrides,
)


@verb
def page(
    model: Annotated[
        str,
        Argument(metavar="MODEL", help="Run folder of commonrail calibrate, injector file or catalogue name."),
    ],
    *,
    out: Annotated[Path, Option(metavar="FILE.html", help="Page to be written.")] = Path("bench.html"),
    slider: Annotated[tuple[str, ...], Option(metavar="PATH", help="Further parameter on a slider; repeatable.")] = (),
    rail_pressure: Annotated[str, Option(help="First rail pressure of a page without data.")] = "100MPa",
    energising_time: Annotated[str, Option(help="First energising time of a page without data.")] = "700us",
    cylinder_pressure: CylinderPressure = None,
    return_pressure: ReturnPressure = None,
    set_: Settings = (),
    threads: Threads = None,
    json: Json = False,
) -> None:
    """Make a page that simulates an injector in the browser.

    One HTML file without server or network: sliders move rate, lifts, pressures, current and quantity map. Of a run
    it shows the measured curves and maps with J, the free parameters, and a fan of fits near the best one.

    \b
    Examples:
      commonrail page runs/paper-1 --out bench.html
      commonrail page virtual-lino-2016 --slider valve.spring_preload
    """
    from commonrail.base.output import write_text, writing
    from commonrail.engine.operating_point import OperatingPoint
    from commonrail.plugins.page.page import page_html
    from commonrail.plugins.page.subject import read_subject

    check_file(out, "--out")
    run = Path(model) if Path(model).is_dir() else None
    point = OperatingPoint(
        parse(rail_pressure, "Pa", "--rail-pressure"),
        read_energisings(energising_time, ()),
        *read_pressures(cylinder_pressure, return_pressure, run),
    )
    if set_ and run is not None:
        raise InputError(f"--set: a page of a run shows its fit; give {run}/calibrated.toml for other values.")
    subject = read_subject(model, slider, threads, changed=lambda injector: with_overrides(injector, set_))
    text = page_html(subject, point)
    with writing(out, "--out"):
        write_text(out, text)
    if json:
        print_json({"kind": "page", "page": str(out), "bytes": len(text.encode())})
    else:
        say(f"wrote {out} ({len(text.encode()) // 1000} kB)")
