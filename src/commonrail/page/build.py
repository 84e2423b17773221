"""The page itself: styles, scripts, numbers and the compiled module in one HTML file."""

from __future__ import annotations

import base64
import json
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment, StrictUndefined, select_autoescape
from markupsafe import Markup

from commonrail.engine.operating_point import OperatingPoint
from commonrail.notice import ALL_ENTRIES, lasting
from commonrail.page.content import content
from commonrail.page.module import wasm_module
from commonrail.page.sliders import variant_of
from commonrail.page.subject import Subject, read_subject

__all__ = ["FIRST_POINT", "page_html", "page_of_run"]

FIRST_POINT = OperatingPoint(100e6, 700e-6)  # of a page whose subject has no data


@lasting(ALL_ENTRIES)
def page_html(subject: Subject, point: OperatingPoint = FIRST_POINT) -> str:
    """Page of a subject, one HTML document that loads nothing.

    Parameters
    ----------
    subject : Subject
    point : OperatingPoint
        First operating point of a page whose subject has no data.

    Raises
    ------
    ConfigurationError
        If the module cannot be made, as in `wasm_module`, or the fuel does not cover the point.
    """
    program = version("commonrail")
    numbers = content(subject, point, program)
    module = wasm_module(variant_of(subject))
    environment = Environment(autoescape=select_autoescape(default_for_string=True), undefined=StrictUndefined)
    return environment.from_string(_asset("bench.html")).render(
        title=subject.title,
        lead=_lead(subject, numbers),
        synthetic=subject.synthetic,
        style=Markup(_asset("bench.css")),
        model=Markup(_embedded(numbers)),
        wasm=base64.b64encode(module).decode(),
        worker=_script("numbers.js", "meter.js", "simulation.js", "worker.js"),
        script=_script("numbers.js", "simulation.js", "plot.js", "bench.js"),
        footer=f"Made by commonrail {program}. The page holds all it needs and loads nothing.",
    )


def page_of_run(folder: Path) -> str:
    """Page of a calibration's run folder, beside whose report it lies."""
    return page_html(read_subject(str(folder)))


def _asset(name: str) -> str:
    return (files("commonrail.page") / "assets" / name).read_text(encoding="utf-8")


def _script(*names: str) -> Markup:
    return Markup("\n".join(map(_asset, names)))


def _embedded(numbers: dict[str, Any]) -> str:
    """JSON that no text in it can end as a script."""
    return json.dumps(numbers, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def _lead(subject: Subject, numbers: dict[str, Any]) -> str:
    step = f"{subject.time_step * 1e6:g} µs"
    told = f"{subject.injector.name}: {numbers['variant']}, simulated in this page in steps of {step}."
    if subject.start:
        told += " The first values are the calibrated ones; sliders are the free parameters between their bounds."
    if numbers["narrowed"] < 1.0:
        told += f" The sliders' ranges are narrowed to {numbers['narrowed']:.0%}, for which steps of {step} are stable."
    return told
