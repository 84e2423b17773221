"""Contract of a kind of measured data: what the house relies on; each clause is a function that fails if broken."""

from __future__ import annotations

import json
import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from commonrail.base.errors import CommonrailError
from commonrail.base.table import Table
from commonrail.calibration.objective import Objective
from commonrail.calibration.result import data_records
from commonrail.data.base import DataSet, value_widths
from commonrail.data.records import LABELS
from commonrail.data.simulator import Simulator
from commonrail.engine.status import OK
from commonrail.physics.injector import Injector
from commonrail.report.data import view as views
from commonrail.report.data.view import Plotted, Shown
from commonrail.runs.fingerprint import hash_values
from tests.data.samples import SAMPLES, STEP, Sample

Kind = type[DataSet]

FREE = ("plunger_needle.k1", "valve.mass")
# The loop and the traced run add up the same steps, and a table keeps every digit: sums round differently.
ROUNDING = 1e-9
SHOWN = {label: Shown(text, label) for label, text in LABELS.items()}


def candidates(injector: Injector, *factors: float) -> np.ndarray:
    """The injector's own values times factors."""
    return np.multiply.outer(factors, [injector.values[name] for name in FREE])


def failing(injector: Injector) -> np.ndarray:
    """A candidate that cannot be simulated: a mass below zero."""
    return candidates(injector, 1.0) * [1.0, -1.0]


def a_block_is_read(kind: Kind, injector: Injector, folder: Path) -> None:
    """Keys that all kinds have, and one measured value for each row."""
    sample = SAMPLES[kind.kind]
    values = 1e-9 * np.arange(1.0, sample.count + 1)
    data = sample.read(kind, injector, folder, values)
    assert isinstance(data, kind)
    assert (data.name, data.role.value, data.weight) == ("data", "fit", 2.5)
    assert (data.source, data.synthetic) == ("bench", "all of it")
    assert data.measured == pytest.approx(values, rel=1e-12)
    assert data.judged.shape == value_widths(data).shape == values.shape
    assert data.bounds is None or len(data.bounds) == len(values) + 1
    assert data.samples >= len(values)
    assert data.points
    assert data.changed(name="other").name == "other"


def a_bad_block_is_refused_with_a_sentence(kind: Kind, injector: Injector, folder: Path) -> None:
    """A unit of another quantity, a cell that is no number, and a pressure that is none."""
    sample = SAMPLES[kind.kind]
    values = 1e-9 * np.ones(sample.count)
    header, _, rows = sample.table(values).partition("\n")
    for table, word in (
        (header.replace("m3", "bar") + "\n" + rows, "bar"),
        (header + "\n" + rows.replace(sample.cell, "much", 1), "line 2"),
    ):
        bad = replace(sample, table=lambda _, text=table: text)
        refused(lambda bad=bad: bad.read(kind, injector, folder, values), word)
    lost = replace(sample, keys=sample.keys + 'rate_unit = "mm3/ms"\nquantity_unit = "mm3"\n')
    with pytest.raises(ValueError, match='no key "'):
        lost.read(kind, injector, folder, values)


def refused(read: Any, word: str) -> None:
    """One sentence with its place."""
    with pytest.raises(CommonrailError) as caught:
        read()
    text = str(caught.value)
    assert word in text
    assert "data.csv" in text
    assert text.endswith(".")
    assert "\n" not in text


def simulation_and_residuals_have_the_data_s_shape(kind: Kind, injector: Injector, folder: Path) -> None:
    """A row for each candidate, a column for each value; candidates do not disturb one another."""
    data = _truth(kind, injector, folder)
    values = candidates(injector, 1.0, 0.8, 1.2)
    simulator = Simulator(injector, FREE, STEP, 1)
    simulated = data.simulated(simulator, values)
    assert simulated.shape == (3, len(data.measured))
    assert data.residuals(simulated).shape == simulated.shape
    assert data.misfit(simulated).shape == (3,)
    assert data.misfit(simulated[1]) == data.misfit(simulated)[1]
    assert np.array_equal(data.simulated(simulator, values[1:2])[0], simulated[1])


def the_truth_costs_nothing(kind: Kind, injector: Injector, folder: Path) -> None:
    """J, residuals, relative error and gain of the injector that made the data, against those of another one."""
    data = _truth(kind, injector, folder)
    objective = Objective(injector, FREE, [data], STEP, 1)
    values = candidates(injector, 1.0, 0.7)
    for own, other in (objective.costs(values).costs, data.misfit(data.simulated(objective.simulator, values))):
        assert own <= 1e-6 * other
    exact, apart = objective.residuals(values)
    assert np.abs(exact).max() <= 1e-6 * np.abs(apart).max()
    score = data.score(Simulator(injector, (), STEP, 1))
    assert score.relative_error() <= 1e-6
    measured, simulated = score.quantities()
    assert simulated == pytest.approx(measured, rel=1e-6)
    gains = np.linspace(0.5, 2.0, 151)
    assert score.best_gain(gains) == pytest.approx(1.0, abs=0.011)


def a_search_and_a_score_agree(kind: Kind, injector: Injector, folder: Path) -> None:
    """Cost of a search: weight · J of the score; it grows with the weight alone."""
    data = _truth(kind, injector, folder)
    objective = Objective(injector, FREE, [data], STEP, 1)
    values = candidates(injector, 0.7)
    other = injector.with_values(dict(zip(FREE, values[0], strict=True)))
    score = data.score(Simulator(other, (), STEP, 1))
    j = float(data.misfit(score.values))
    found = objective.costs(values)
    assert found.costs[0] == pytest.approx(data.weight * j, rel=ROUNDING)
    assert objective.misfits(values)[0, 0] == pytest.approx(j, rel=ROUNDING)
    assert found.simulations == objective.injections == len(data.simulated_points)
    heavy = Objective(injector, FREE, [replace(data, weight=5.0)], STEP, 1)
    assert heavy.costs(values).costs[0] == pytest.approx(2.0 * found.costs[0], rel=1e-12)
    pair = Objective(injector, FREE, [data, data.changed(name="twin")], STEP, 1)
    assert pair.costs(values).costs[0] == pytest.approx(2.0 * found.costs[0], rel=1e-12)
    squares = [np.sum(o.residuals(values) ** 2) for o in (objective, heavy)]
    assert squares[1] == pytest.approx(2.0 * squares[0], rel=1e-12)


def a_failed_simulation_costs_everything(kind: Kind, injector: Injector, folder: Path) -> None:
    """Infinite cost with its status, values that are no numbers, and points that say so."""
    data = _truth(kind, injector, folder)
    scores = Objective(injector, FREE, [data], STEP, 1).costs(failing(injector))
    assert np.isposinf(scores.costs).all()
    assert (scores.statuses != OK).all()
    assert not np.isfinite(data.simulated(Simulator(injector, FREE, 20e-6, 1), candidates(injector, 1.0))).any()
    score = data.score(Simulator(injector, (), 20e-6, 1))
    assert not np.isfinite(data.misfit(score.values))
    assert [m.point for m in score.missing()] == list(data.points)
    (record,) = data_records([data], {"best": [score]})
    json.dumps(record, allow_nan=False)
    assert not views.view_of(kind.kind).has(record, "best")


def a_record_survives_the_file(kind: Kind, injector: Injector, folder: Path) -> None:
    """JSON without NaN, read back the same, with the figures of every label."""
    record = _record(_truth(kind, injector, folder), injector)
    assert json.loads(json.dumps(record, allow_nan=False)) == record
    assert record["kind"] == kind.kind
    assert all(views.view_of(kind.kind).has(record, label) for label in LABELS)
    point = views.view_of(kind.kind).operating_point(record)
    assert {"rail_pressure", "energising_time", "cylinder_pressure", "return_pressure"} <= set(point)


def tables_and_figures_have_something_to_show(kind: Kind, injector: Injector, folder: Path) -> None:
    """For a calibration and for a comparison; as many cells in a row as columns, and a number at least."""
    data = _truth(kind, injector, folder)
    record, view = _record(data, injector), views.view_of(kind.kind)
    plotted = Plotted(SHOWN, {data.name: _trace(data, injector)})
    calibrated, compared = view.tables([record], LABELS), view.compared_tables([record], list(LABELS))
    for table in (*calibrated, *compared):
        assert isinstance(table, Table)
        assert table.rows
        assert all(len(row) == len(table.columns) for row in table.rows)
        assert any(any(sign.isdigit() for sign in cell.text) for row in table.rows for cell in row)
    for figures in (view.figures(record, plotted), view.compared_figures(record, plotted)):
        assert figures
        for figure in figures:
            assert any(y is not None for panel in figure.panels for s in panel.series for y in s.y)
    assert all(view.merit([record])[:2])  # a figure and its words
    what, (errors,) = view.leading([record])
    assert what
    assert set(errors) == set(LABELS)


def data_travel_and_tell_themselves_apart(kind: Kind, injector: Injector, folder: Path) -> None:
    """To workers, and in the fingerprint of a study: another value or weight makes another study."""
    data = _truth(kind, injector, folder)
    objective = Objective(injector, FREE, [data], STEP, 1)
    there = pickle.loads(pickle.dumps(objective))
    values = candidates(injector, 0.9)
    assert there.costs(values).costs.tobytes() == objective.costs(values).costs.tobytes()
    sample = SAMPLES[kind.kind]
    changed = sample.read(kind, injector, folder, 1.01 * np.maximum(data.measured, 1e-12))
    prints = [hash_values(one) for one in (data, replace(data), replace(data, weight=3.0), changed)]
    assert prints[0] == prints[1]
    assert len(set(prints)) == 3


CLAUSES = (
    a_block_is_read,
    a_bad_block_is_refused_with_a_sentence,
    simulation_and_residuals_have_the_data_s_shape,
    the_truth_costs_nothing,
    a_search_and_a_score_agree,
    a_failed_simulation_costs_everything,
    a_record_survives_the_file,
    tables_and_figures_have_something_to_show,
    data_travel_and_tell_themselves_apart,
)


def _truth(kind: Kind, injector: Injector, folder: Path) -> Any:
    sample: Sample = SAMPLES[kind.kind]
    return sample.truth(kind, injector, folder)


def _scores(data: DataSet, injector: Injector) -> dict[str, Any]:
    models = [injector.with_values({"valve.mass": f * injector.values["valve.mass"]}) for f in (0.7, 1.3, 1.0, 1.1)]
    return {label: data.score(Simulator(m, (), STEP, 1)) for label, m in zip(LABELS, models, strict=True)}


def _record(data: DataSet, injector: Injector) -> dict[str, Any]:
    return data_records([data], {label: [score] for label, score in _scores(data, injector).items()})[0]


def _trace(data: DataSet, injector: Injector) -> dict[str, np.ndarray]:
    if data.bounds is None:
        return {}
    simulated = {label: score.values for label, score in _scores(data, injector).items()}
    return {"time_s": 0.5 * (data.bounds[1:] + data.bounds[:-1]), "measured": data.measured, **simulated}
