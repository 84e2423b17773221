"""Verb that injects at small changes of the energising time, and the kind of its result with its page."""

import html
import json as json_
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import click
import numpy as np

import commonrail
from commonrail.base.output import write_text
from commonrail.base.units import parse
from commonrail.cli.grammar import Argument, Option, verb
from commonrail.cli.options import check_folder
from commonrail.report.result_kind import ResultKind

CHANGES = (-10e-6, 0.0, 10e-6)  # [s]


@verb
def spread(
    injector: Annotated[str, Argument(help="Injector file, or a name of the catalogue.")],
    *,
    rail_pressure: Annotated[str, Option(help="With its unit, 160MPa.")],
    energising_time: Annotated[str, Option(help="With its unit, 700us.")],
    out: Annotated[Path, Option(metavar="DIR", help="A new or empty folder for spread.json and the report.")],
) -> None:
    """Inject with 10 us less and more energising time.

    \b
    Example:
      commonrail spread example-injector --rail-pressure 160MPa --energising-time 700us --out spread
    """
    check_folder(out)
    model = commonrail.load_injector(injector)
    middle = parse(energising_time, "s", "--energising-time")
    points = [commonrail.OperatingPoint(rail_pressure, middle + change) for change in CHANGES]
    volumes = [commonrail.simulate(model, point).injected_volume for point in points]
    record = {"schema": 1, "kind": "spread", "injector": model.name, "volumes": volumes}
    out.mkdir(parents=True, exist_ok=True)
    write_text(out / RESULT.file, json_.dumps(record))
    write_text(out / "report.html", _page(record, out))
    click.echo(f"{np.ptp(volumes) * 1e9:.2f} mm3 from least to most; the report is {out / 'report.html'}")


def _page(record: Mapping[str, Any], folder: Path) -> str:
    rows = "".join(
        f"<tr><td>{change * 1e6:+g} us<td>{volume * 1e9:.2f} mm³"
        for change, volume in zip(CHANGES, record["volumes"], strict=True)
    )
    return f"<!DOCTYPE html><title>Spread</title><h1>{html.escape(record['injector'])}</h1><table>{rows}</table>"


RESULT = ResultKind("spread.json", "spread", "spread", _page, ("injector", "volumes"))
