"""Tolerance studies of the virtual injector: the figures of its parts, the trim, and a study that is stopped."""

from __future__ import annotations

import json
import re
import signal
from dataclasses import replace

import numpy as np
import pytest

from commonrail.base.errors import ConfigurationError, SimulationError
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.simulate import simulate, simulate_batch
from commonrail.engine.status import Status
from commonrail.physics.injector import Injector
from commonrail.plugins.tolerance.file import ToleranceResult
from commonrail.plugins.tolerance.run import Progress, tolerance
from commonrail.plugins.tolerance.statistics import Draws, PartSimulator
from commonrail.plugins.tolerance.study import (
    Dimension,
    Limit,
    Normal,
    SeriesTrim,
    TolerancePoint,
    Tolerances,
    Uniform,
)
from commonrail.plugins.tolerance.trim import _with_time, trim_parts

HOLE, GAP = "nozzle.hole_diameter", "control_chamber.a_hole_diameter"
FULL = TolerancePoint("full", OperatingPoint("160 MPa", "600 us"), Limit(-0.02, True), Limit(0.02, True))
PART = TolerancePoint("part", OperatingPoint("160 MPa", "450 us"))


@pytest.fixture(scope="module")
def study(pwm: Injector) -> Tolerances:
    """Two dimensions at two points."""
    dimensions = (Dimension(HOLE, Normal(130e-6, 0.7e-6)), Dimension(GAP, Uniform(258e-6, 262e-6)))
    return Tolerances("made up", pwm, dimensions, (FULL, PART), trim=SeriesTrim(("full", "part"), 100), parts=1000)


@pytest.fixture(scope="module")
def found(study: Tolerances) -> ToleranceResult:
    return tolerance(study)


def test_the_figures_are_those_of_the_parts(study: Tolerances, found: ToleranceResult) -> None:
    batch = simulate_batch(study.injector, [FULL.point, PART.point], study.names, Draws(study).take(1000))
    for k, point in enumerate(found.points):
        quantities = batch.injected_volume[:, k]
        assert point.spread.mean == pytest.approx(float(quantities.mean()), rel=1e-12)
        assert point.spread.deviation == pytest.approx(float(quantities.std(ddof=1)), rel=1e-9)
        assert point.nominal == pytest.approx(simulate(study.injector, study.points[k].point).injected_volume, rel=1e-9)
    full = found.points[0]
    quantities = batch.injected_volume[:, 0]
    beyond = np.abs(quantities / full.nominal - 1.0) > 0.02
    assert full.spread.below + full.spread.above == np.count_nonzero(beyond) > 0


def test_the_shares_are_those_of_one_dimension_at_a_time(study: Tolerances, found: ToleranceResult) -> None:
    draws = Draws(study).take(1000)
    alone = []
    for j in range(2):
        values = np.tile([study.injector.values[name] for name in study.names], (1000, 1))
        values[:, j] = draws[:, j]
        alone.append(simulate_batch(study.injector, [FULL.point], study.names, values).injected_volume.var())
    shares = {row.name: row.share.value for row in found.points[0].dimensions if row.share is not None}
    # the injector is nearly linear within its tolerances: interactions are below 1 %
    assert [shares[name] for name in study.names] == pytest.approx(np.array(alone) / sum(alone), abs=0.02)


def test_a_trimmed_part_is_simulated_at_its_own_energising_time(study: Tolerances, found: ToleranceResult) -> None:
    simulated = PartSimulator(study)
    values = Draws(study).take(1000)
    parts = simulated.parts(values)
    nominal = simulated.parts(None).quantities[0]
    slopes = [
        (
            simulated.at(_with_time(p.point, t + 10e-6), None).quantities
            - simulated.at(_with_time(p.point, t - 10e-6), None).quantities
        )
        / 20e-6
        for p, t in ((FULL, 600e-6), (PART, 450e-6))
    ]
    quantities = []
    for i in range(100):
        shift = round(float((nominal[0] - parts.quantities[i, 0]) / slopes[0][0, 0]) / 1e-6) * 1e-6
        injector = study.injector.with_values(dict(zip(study.names, values[i].tolist(), strict=True)))
        quantities.append(simulate_batch(injector, [_with_time(FULL.point, 600e-6 + shift)]).injected_volume[0, 0])
    assert found.trim is not None
    full = found.trim.points[0]
    assert full.after.mean == pytest.approx(float(np.mean(quantities)), rel=1e-9)
    assert full.after.deviation == pytest.approx(float(np.std(quantities, ddof=1)), rel=1e-6)


def test_the_trim_narrows_the_spread_at_its_test_points(found: ToleranceResult) -> None:
    assert found.trim is not None
    assert found.trim.parts == 100
    for point in found.trim.points:
        assert point.after.deviation < 0.4 * point.before.deviation


def test_scatter_of_the_measurement_stays_in_the_trimmed_parts(study: Tolerances) -> None:
    loud = replace(study, trim=SeriesTrim(("full",), 1000, scatter=1e-9))
    simulated = PartSimulator(loud)
    parts, nominal = simulated.parts(Draws(loud).take(1000)), simulated.parts(None).quantities[0]
    after = trim_parts(simulated, parts, nominal, [(None, None)] * 2, 0.95, lambda *_: None).points[0].after
    # 1 mm³ of the bench goes through the correction; 1000 parts tell it to 2.2 %
    assert after.deviation == pytest.approx(1e-9, rel=0.15)


def test_the_record_has_no_number_that_is_none(found: ToleranceResult) -> None:
    record = found.record()
    json.dumps(record, allow_nan=False)
    assert [row["point"] for row in found.rows()] == ["full", "full", "part", "part"]
    assert {row["dimension"] for row in found.rows()} == {HOLE, GAP}
    assert record["points"][1]["spread"]["cpk"] is None


def test_the_result_does_not_depend_on_threads(study: Tolerances, found: ToleranceResult) -> None:
    again = tolerance(replace(study, trim=None), threads=1).record()
    assert again["points"] == found.record()["points"]


def test_a_study_that_is_stopped_keeps_its_parts(study: Tolerances) -> None:
    def stop(progress: Progress) -> None:
        if progress.done >= 128:
            signal.raise_signal(signal.SIGINT)

    first = []
    found = tolerance(study, progress=lambda p: (first.append(p), stop(p) if len(first) == 2 else None)[0])
    assert (found.status, found.trim) == ("interrupted", None)
    assert found.parts == first[-1].done < study.parts
    batch = simulate_batch(study.injector, [FULL.point], study.names, Draws(study).take(found.parts))
    assert found.points[0].spread.mean == pytest.approx(float(batch.injected_volume.mean()), rel=1e-12)
    assert found.points[0].spread.parts == found.parts


def test_a_drawing_that_cannot_be_simulated_is_refused(study: Tolerances) -> None:
    short = TolerancePoint("short", OperatingPoint("160 MPa", "600 us", horizon="650 us"))
    with pytest.raises(SimulationError, match=f"short: {re.escape(Status.STILL_INJECTING.sentence)}"):
        tolerance(replace(study, points=(short,), trim=None))


def test_crossed_limits_are_refused(study: Tolerances) -> None:
    crossed = replace(FULL, lower=Limit(0.03, True))
    with pytest.raises(ConfigurationError, match=r"^full: .*limit"):
        tolerance(replace(study, points=(crossed,), trim=None))


def test_a_point_at_which_nothing_is_injected_cannot_trim(study: Tolerances) -> None:
    closed = TolerancePoint("closed", OperatingPoint("160 MPa", "60 us"))
    with pytest.raises(SimulationError, match=r"^closed: .*nominal"):
        tolerance(replace(study, points=(closed,), trim=SeriesTrim(("closed",), 100)))


def test_a_count_has_no_tolerance() -> None:
    with pytest.raises(ConfigurationError, match=r"nozzle\.holes .*count"):
        Dimension("nozzle.holes", Uniform(6.5, 7.5))
