"""Sections of a page that all kinds of fit share: the course of the search, and facts on it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from commonrail.base.arrays import Floats
from commonrail.base.chart import Figure
from commonrail.base.text import duration, significant
from commonrail.calibration.optimisers.registry import size_in_words
from commonrail.calibration.record import FitRecord, GenerationRecord, ParameterRecord
from commonrail.report.figure import figure_html
from commonrail.report.fit.diagnostics import COURSE_CAPTION, course_panel
from commonrail.report.fit.figures import convergence_figure

Fact = tuple[str, str]

_FIRST = {
    "feasible": "drawn from what is feasible",
    "uniform": "drawn from the whole box",
    "reference": "the start values, the rest drawn from what is feasible",
}


def convergence_section(
    generations: Sequence[GenerationRecord],
    parameters: Sequence[ParameterRecord] = (),
    course: Floats | None = None,
) -> tuple[Figure, str] | None:
    """Figure of the objective and of the best parameters over the generations, and its HTML; None of fewer than two.

    `course` are the best candidates after each generation (generations, d) [SI].
    """
    if len(generations) < 2:
        return None
    figure = convergence_figure(generations)
    if course is not None:
        panels = (*figure.panels, *course_panel(parameters, course))
        figure = replace(figure, caption=f"{figure.caption} {COURSE_CAPTION}", panels=panels)
    return figure, figure_html(figure, "convergence")


def search_facts(record: FitRecord, counted: str = "injections", more: Sequence[Fact] = ()) -> list[Fact]:
    """Facts on the search; `counted` is the word for simulations, `more` are facts placed before the software."""
    counts, clock, objective = record.evaluations, record.clock, record.objective
    evaluations = f"{counts.slots:,} candidates proposed; {counts.simulated:,} simulated; {counts.failed:,} failed"
    speed = f"{significant(clock.simulations_per_second, 3)} {counted}/s"
    robust = [("Loss", f"soft L1 of scale {significant(record.loss_scale, 4)}")] if record.loss_scale else []
    return [
        ("Search", _search(record.optimiser)),
        *robust,
        ("Objective", f"{significant(objective.start)} to {significant(objective.best)}"),
        ("Evaluations", evaluations),
        ("Simulations", f"{counts.injections or counts.simulations:,} {counted}; {speed}"),
        ("Time of the search", duration(clock.seconds)),
        ("Ended", f"{record.status}: {record.reason or 'the optimiser was done'}"),
        ("Seed", str(record.seed)),
        *more,
        ("Software", ", ".join(f"{name} {number}" for name, number in record.software.items())),
    ]


def _search(settings: Mapping[str, Any]) -> str:
    polish = f"; {settings['polish']} least-squares refinements" if settings["polish"] else ""
    initial = settings.get("initial", "")
    first = f"; first population {_FIRST.get(initial, initial)}" if initial else ""
    return f"{settings['method']}, {size_in_words(settings)}{first}{polish}"
