"""Content that notebooks show of each kind of result: sentences, tables and figures, those of the reports."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

from commonrail.analysis.certainty.certify import Certainty
from commonrail.analysis.design.next import Plan
from commonrail.analysis.posterior.sample import Posterior
from commonrail.analysis.prediction.predict import Prediction
from commonrail.analysis.sensitivity.result import Sensitivity
from commonrail.analysis.tolerance.result import ToleranceResult
from commonrail.calibration.comparison import Comparison
from commonrail.calibration.result import result_record
from commonrail.calibration.run import Calibration
from commonrail.calibration.study import Study
from commonrail.display.chart import Figure
from commonrail.display.heat_map import HeatMap
from commonrail.display.table import Table, tabulated
from commonrail.display.text import fixed, quantity, significant
from commonrail.engine.solution import Batch, Solution
from commonrail.files.run_folder import rate_curves
from commonrail.injector.definition import Injector
from commonrail.kinds.base import DataSet
from commonrail.maps.quantity_map import InjectionMap
from commonrail.maps.sweep import Sweep
from commonrail.report.error_map import error_maps
from commonrail.report.figures import convergence_figure, figures_of
from commonrail.report.fit_faces import (
    certainty_face_lines,
    certainty_face_tables,
    plan_line,
    posterior_lines,
    posterior_tables,
    prediction_lines,
    prediction_tables,
)
from commonrail.report.map import map_figures, map_lines, map_tables
from commonrail.report.next import plan_lines, plan_tables
from commonrail.report.parameters import parameter_table
from commonrail.report.sensitivity import sensitivity_figures, sensitivity_lines, sensitivity_tables
from commonrail.report.simulation import course_figure
from commonrail.report.sweep import sweep_figures, sweep_lines
from commonrail.report.tables import tables_of
from commonrail.report.tolerance import tolerance_figures, tolerance_lines, tolerance_tables

__all__ = ["Drawn", "Face", "face_of"]

MICRO, MM3 = 1e6, 1e9
LONGEST = 100  # letters of a title within a line

Drawn = Figure | HeatMap


class Face(NamedTuple):
    """Content that a notebook shows of one kind of result: sentences, the first being its line, tables, figures."""

    lines: Callable[[Any], Sequence[str]]
    tables: Callable[[Any], Sequence[Table]] = lambda _: ()
    figures: Callable[[Any], Sequence[Drawn]] = lambda _: ()


def _solution_lines(s: Solution) -> list[str]:
    return [
        f"{s.status.name}; {fixed(s.injected_volume, 2, MM3)} mm³ injected, {fixed(s.returned_volume, 2, MM3)} mm³ "
        f"returned; opens at {fixed(s.opening, 1, MICRO)} µs, closes at {fixed(s.closing, 1, MICRO)} µs"
    ]


def _batch_lines(batch: Batch) -> list[str]:
    candidates, points = batch.injected_mass.shape
    return [f"{candidates} candidates at {points} operating points, {int(batch.failed.sum())} simulations failed"]


def _injector_lines(injector: Injector) -> list[str]:
    lines = [f"{injector.name}, {injector.variant.label}, {len(injector.values)} parameters"]
    return lines + ([injector.synthetic] if injector.synthetic else [])


def _study_lines(study: Study) -> list[str]:
    names = ", ".join(data.name for data in study.data[:4]) + (", …" if len(study.data) > 4 else "")
    count = study.space.dimension
    return [f"“{study.title}”: {count} parameter{'' if count == 1 else 's'} of {study.injector.name}; data {names}"]


def _study_tables(study: Study) -> list[Table]:
    return [_free_table(study), _data_table(study.data)]


def _free_table(study: Study) -> Table:
    return tabulated(
        "Free parameters",
        study.space.parameters,
        [
            ("parameter", lambda p: p.name),
            ("start", lambda p: quantity(p.reference, p.unit)),
            ("lower", lambda p: quantity(p.lower, p.unit)),
            ("upper", lambda p: quantity(p.upper, p.unit)),
        ],
    )


def _data_table(data: Sequence[DataSet]) -> Table:
    return tabulated(
        "Data",
        data,
        [
            ("data set", lambda d: d.name),
            ("kind", lambda d: d.kind),
            ("role", lambda d: d.role.value),
            ("values", lambda d: str(len(d.measured))),
            ("points", lambda d: str(len(d.points))),
        ],
        "",
        3,
    )


def _calibration_lines(c: Calibration) -> list[str]:
    ending = f"; {c.convergence.sentence}" if c.convergence else ""
    fall = f"{significant(c.start_cost)} → {significant(c.cost)}"
    return [
        f"“{c.study.title[:LONGEST]}”: objective {fall}, {c.status}{ending}",
        *(str(finding.sentence) for finding in c.warnings),
    ]


def _calibration_tables(c: Calibration) -> list[Table]:
    record = result_record(c, {})
    return [parameter_table(record["parameters"]), *tables_of(record["data"], record["labels"])]


def _calibration_figures(c: Calibration) -> Iterator[Drawn]:
    record = result_record(c, {})
    traces = {
        curve.data: {"time_s": 0.5 * (curve.bounds[1:] + curve.bounds[:-1]), **curve.rates}
        for curve in rate_curves(c.study.data, c.scores)
    }
    yield from error_maps(record)
    yield from figures_of(record, traces)
    if len(record["generations"]) > 1:
        yield convergence_figure(record["generations"])


def _map_figures(found: InjectionMap) -> list[Drawn]:
    heats, curves = map_figures({found.injector.name: found})
    return [*heats, *curves]


_FACES: tuple[tuple[type, Face], ...] = (
    (Solution, Face(_solution_lines, figures=lambda s: [course_figure({"": s})])),
    (Batch, Face(_batch_lines)),
    (Injector, Face(_injector_lines)),
    (Study, Face(_study_lines, _study_tables)),
    (Calibration, Face(_calibration_lines, _calibration_tables, lambda c: list(_calibration_figures(c)))),
    (
        InjectionMap,
        Face(lambda m: map_lines({m.injector.name: m}), lambda m: map_tables({m.injector.name: m}), _map_figures),
    ),
    (Sweep, Face(sweep_lines, figures=sweep_figures)),
    (
        Sensitivity,
        Face(
            lambda s: [s.title, *sensitivity_lines(s.record())],
            lambda s: sensitivity_tables(s.record()),
            lambda s: sensitivity_figures(s.record()),
        ),
    ),
    (
        ToleranceResult,
        Face(
            lambda t: [t.tolerances.title, *tolerance_lines(t.record())],
            lambda t: tolerance_tables(t.record()),
            lambda t: tolerance_figures(t.record()),
        ),
    ),
    (Certainty, Face(certainty_face_lines, certainty_face_tables)),
    (Prediction, Face(prediction_lines, prediction_tables)),
    (Posterior, Face(posterior_lines, posterior_tables)),
    (Plan, Face(lambda p: [plan_line(p), *plan_lines(p)], plan_tables)),
    (
        Comparison,
        Face(lambda c: [f"{len(c.models)} models on {len(c.data)} data sets: {', '.join(c.models)}"]),
    ),
)


def face_of(result: Any) -> Face:
    """Face of a result."""
    return next(face for kind, face in _FACES if isinstance(result, kind))
