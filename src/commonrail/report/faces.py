"""Presenters of simulations, injectors, studies, fits and comparisons: what notebooks show of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from commonrail.calibration.comparison import Comparison
from commonrail.calibration.result import result_record
from commonrail.calibration.run import Calibration
from commonrail.calibration.study import Study
from commonrail.display.table import Table, tabulated
from commonrail.display.text import fixed, quantity, significant
from commonrail.engine.solution import Batch, Solution
from commonrail.files.run_folder import rate_curves
from commonrail.injector.definition import Injector
from commonrail.kinds.base import DataSet
from commonrail.report.error_map import error_maps
from commonrail.report.figures import convergence_figure, figures_of
from commonrail.report.parameters import parameter_table
from commonrail.report.presenter import Array, Arrays, Drawn, Presenter, in_common_unit
from commonrail.report.simulation import course_figure
from commonrail.report.tables import tables_of

MICRO, MM3 = 1e6, 1e9
LONGEST = 100  # letters of a title within a line


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


def _comparison_lines(c: Comparison) -> list[str]:
    return [f"{len(c.models)} models on {len(c.data)} data sets: {', '.join(c.models)}"]


_CHANNELS = {"lift": "m", "pressure": "Pa", "current": "A", "force": "N", "coefficient": "1"}


def _solution_arrays(found: Solution) -> Arrays:
    """Middles of the samples; a channel there is the mean of both bounds."""
    values = {"rate": in_common_unit(("time",), found.rate, "m3/s")}
    for name, channel in found.channels.items():
        unit = next((u for ending, u in _CHANNELS.items() if name.endswith(ending)), "")
        values[name] = in_common_unit(("time",), 0.5 * (channel[1:] + channel[:-1]), unit)
    return Arrays({"time": in_common_unit(("time",), found.sample_time, "s")}, values, "Course of an injection")


def _batch_arrays(found: Batch) -> Arrays:
    axes = ("candidate", "point")
    sizes = zip(axes, found.injected_mass.shape, strict=True)
    values = {
        "injected_volume": in_common_unit(axes, found.injected_volume, "m3"),
        "returned_volume": in_common_unit(axes, found.returned_volume, "m3"),
        **{name: in_common_unit(axes, getattr(found, name), "s") for name in ("opening", "closing", "first_closing")},
        "greatest_lift": in_common_unit(axes, found.greatest_lift, "m"),
        "status": Array(axes, found.status),
    }
    return Arrays({name: Array((name,), np.arange(size)) for name, size in sizes}, values, "Figures of injections")


def _calibration_arrays(found: Calibration) -> Arrays:
    arrays = _study_arrays(found.study)
    best = np.array([found.best[name] for name in found.study.space.names])
    return arrays._replace(values={"calibrated": Array(("parameter",), best), **arrays.values})


def _study_arrays(found: Study) -> Arrays:
    """Free parameters in SI units."""
    own = found.space.parameters
    axis = ("parameter",)
    values = {key: Array(axis, np.array([getattr(p, name) for p in own])) for key, name in _BOUNDS.items()}
    return Arrays({"parameter": Array(axis, np.array([p.name for p in own]))}, values, found.title)


_BOUNDS = {"start": "reference", "lower": "lower", "upper": "upper", "unit": "unit"}


def _injector_arrays(found: Injector) -> Arrays:
    names = list(found.values)
    axis = ("parameter",)
    values = {
        "value": Array(axis, np.array([found.values[name] for name in names])),
        "unit": Array(axis, np.array([found.quantities[name].unit for name in names])),
        "meaning": Array(axis, np.array([found.quantities[name].meaning for name in names])),
    }
    return Arrays({"parameter": Array(axis, np.array(names))}, values, found.title)


SOLUTION = Presenter(_solution_lines, figures=lambda s: [course_figure({"": s})], arrays=_solution_arrays)
BATCH = Presenter(_batch_lines, arrays=_batch_arrays)
INJECTOR = Presenter(_injector_lines, arrays=_injector_arrays)
STUDY = Presenter(_study_lines, _study_tables, arrays=_study_arrays)
CALIBRATION = Presenter(
    _calibration_lines, _calibration_tables, lambda c: list(_calibration_figures(c)), _calibration_arrays
)
COMPARISON = Presenter(_comparison_lines)
