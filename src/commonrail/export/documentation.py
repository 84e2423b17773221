"""Page inside an FMU: what it is, its variables, its limits."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from importlib.metadata import version

from commonrail.export.sources import Model
from commonrail.export.variables import Variable

__all__ = ["documentation_page"]

_STYLE = (
    "body{font:15px/1.5 system-ui,sans-serif;max-width:70rem;margin:2rem auto;padding:0 1rem}"
    "table{border-collapse:collapse}td,th{padding:.2rem .6rem;border-bottom:1px solid #8884;text-align:left}"
)
_TEXT = (
    "Set the pressures of the boundaries and, before the initialization, any parameter. Energise the solenoid by the "
    "Boolean input command, or plan up to four energisings by the parameters energising[i]; do not mix the two.",
    "All numbers are in SI units; display units are bar, mg, um and us. The inner time step is time_step. Any "
    "communication step is possible: outputs are those of the last inner step that has been completed, inputs are held "
    "over a communication step, and edges of command fall on communication points to the exact time.",
    "A simulation that fails (a parameter outside its domain, a time step that is too long, pressures that the fuel "
    "does not cover) says so in one sentence to the logger, and the step is discarded.",
)


def documentation_page(model: Model, listed: Sequence[Variable]) -> str:
    """HTML text.

    Parameters
    ----------
    model : Model
    listed : sequence of Variable
    """
    injector = model.injector
    notes = [f"Not measured: {injector.synthetic}"] if injector.synthetic else []
    low, high = (1e-6 * p for p in injector.fuel.pressure_range)
    coldest, hottest = injector.fuel.temperature_range
    notes += [
        f"Wiring: {injector.wired().label}.",
        f"Fuel: {injector.fuel.title}, from {low:g} to {high:g} MPa and {coldest:g} to {hottest:g} K.",
        "Values that were fitted to bench data hold for the operating points of that bench.",
    ]
    paragraphs = "".join(f"<p>{escape(text)}</p>" for text in (*_TEXT, *notes))
    head = "<tr><th>variable</th><th>kind</th><th>unit</th><th>start</th><th>meaning</th></tr>"
    rows = "".join(
        f"<tr><td>{escape(v.name)}</td><td>{v.kind.causality}</td><td>{escape(v.unit)}</td>"
        f"<td>{'' if v.start is None else f'{v.start:.6g}'}</td><td>{escape(v.meaning)}</td></tr>"
        for v in listed
    )
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{escape(injector.name)}</title>'
        f"<style>{_STYLE}</style><h1>{escape(injector.name)}</h1><p>{escape(injector.title)}</p>{paragraphs}"
        f"<table>{head}{rows}</table><p>Written by commonrail {escape(version('commonrail'))}.</p></html>\n"
    )
