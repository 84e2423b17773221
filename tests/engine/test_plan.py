"""Jobs: blocks of lanes, means of the inputs, the energisings' clocks."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.base.errors import ConfigurationError
from commonrail.engine import plan
from commonrail.engine import plan as population
from commonrail.engine.courses import CHECK_AFTER
from commonrail.engine.job import Courses
from commonrail.engine.lanes import tabulate
from commonrail.engine.operating_point import Energising, OperatingPoint, Trace
from commonrail.physics.injector import Injector, parameter_paths


def of(*points: OperatingPoint, injector: Injector) -> Courses:
    return plan.prepare(injector, points, 1e-6).courses


def long(rail: float, horizon: float, start: float = 0.0) -> OperatingPoint:
    return OperatingPoint(rail, ((start, 20e-6),), horizon=horizon, start=start)


def test_lanes_hold_every_candidate_at_every_point(regulated: Injector) -> None:
    courses = of(long(100e6, 40e-6), long(80e6, 90e-6), long(90e6, 60e-6), injector=regulated)
    points, candidates = plan.fill_lanes(courses, 11, 8)
    assert points.shape == candidates.shape == (5, 8)  # 33 of 40
    filled = list(zip(points.ravel().tolist(), candidates.ravel().tolist(), strict=True))
    assert set(filled) == {(p, c) for p in range(3) for c in range(11)}
    assert filled[33:] == [filled[32]] * 7  # the last one fills its block
    ends = courses.steps[points].ravel()
    assert np.all(np.diff(ends) <= 0)  # long ones first


def test_points_that_are_to_stay_apart_share_no_block(regulated: Injector) -> None:
    courses = of(long(100e6, 40e-6), long(80e6, 90e-6), injector=regulated)
    points, candidates = plan.fill_lanes(courses, 11, 8, separate_points=True)
    assert points.tolist() == [[1] * 8, [1] * 8, [0] * 8, [0] * 8]
    assert candidates.reshape(2, 16).tolist() == [[*range(11), *[10] * 5]] * 2


def test_points_with_times_of_their_own_share_no_block(regulated: Injector) -> None:
    points = [long(100e6, 40e-6, start) for start in (0.0, 0.0, -1e-6, 0.0, -1e-6)]
    courses = of(*points, injector=regulated)
    blocks, _ = plan.fill_lanes(courses, 2, 8)
    assert len(courses.times) == 2
    assert [set(courses.clock[row].tolist()) for row in blocks] == [{0}, {1}]


def test_figures_come_back_in_the_order_of_candidates_and_points(regulated: Injector) -> None:
    prepared = plan.prepare(regulated, [long(100e6, 40e-6), long(80e6, 90e-6), long(90e6, 60e-6)], 1e-6)
    job = plan.make_job(prepared, np.repeat(prepared.row[None], 11, axis=0), True)
    figures = 100.0 * job.points + job.candidates
    assert np.array_equal(tabulate(figures, job), np.arange(11)[:, None] + 100.0 * np.arange(3))


def test_candidates_differ_in_the_named_columns_only(regulated: Injector) -> None:
    names = ("valve.mass", "fuel.temperature")
    theta = population.candidate_matrix(regulated, names, np.array([[6e-3, 353.15], [5e-3, 313.15]]))
    mass = parameter_paths().index("valve.mass")
    assert theta[:, mass].tolist() == [6e-3, 5e-3]
    known = len(parameter_paths())
    assert np.array_equal(np.delete(theta[0, :known], mass), np.delete(theta[1, :known], mass))
    # cold fuel is denser: the first fuel coefficient is the density at zero pressure
    assert theta[1, known] > theta[0, known] + 20.0


def test_inputs_are_means_over_a_step_and_clocks(regulated: Injector) -> None:
    rail = Trace((0.0, 10e-6, 20e-6), (100e6, 110e6, 100e6))
    point = OperatingPoint(rail, (Energising(2e-6, 3e-6), Energising(8e-6, 4e-6)), start=-4e-6, horizon=20e-6)
    courses = plan.prepare(regulated, [point], 1e-6).courses
    inputs = courses.inputs[0]
    begin = -4e-6 + 1e-6 * np.arange(20)
    middle = np.interp(begin + 0.5e-6, rail.time, rail.value)
    assert inputs[:, 0] == pytest.approx(middle, rel=1e-12)  # no knot lies inside a step
    assert inputs[12, 4:] == pytest.approx([0.0, -4e-6], abs=1e-12)  # t = 8 us: the second begins
    assert inputs[11, 4:] == pytest.approx([5e-6, 2e-6], abs=1e-12)
    # the rail at the start, before the first sample of its trace
    assert courses.settings == pytest.approx(np.array([[100e6, 5e6, 0.5e6]]), rel=1e-12)
    assert courses.earliest_end[0] == round((12e-6 + 4e-6 + CHECK_AFTER) / 1e-6)


def naive_clocks(point: OperatingPoint, begin: float, dt: float) -> tuple[float, float]:
    """Clocks of a step, one energising after the other."""
    begun = [p for p in point.pulses if p.start < begin + dt * (1.0 - 1e-9)] or list(point.pulses[:1])
    if not begun:
        return -1.0, -1.0
    before = sum(
        max(min(p.start + p.duration, begin + dt) - max(p.start, begin), 0.0) for p in point.pulses[: len(begun) - 1]
    )
    last = begun[-1]
    return begin - last.start + before, begin - (last.start + last.duration)


PULSES = {
    "none": (),
    "of no length": ((3e-6, 0.0),),
    "late": ((5.3e-6, 4.2e-6),),
    "two in one step": ((2.1e-6, 0.3e-6), (2.6e-6, 0.2e-6), (9.4e-6, 3e-6)),
    "end and begin in one step": ((1e-6, 4.4e-6), (5.7e-6, 2e-6), (7.8e-6, 3e-6)),
    "without a pause": ((0.0, 4e-6), (4e-6, 4e-6), (8e-6, 2.5e-6)),
    "behind the horizon": ((1e-6, 2e-6), (30e-6, 5e-6)),
}


@pytest.mark.parametrize("start", [0.0, -1.7e-6])
def test_clocks_are_those_of_the_energising_that_has_begun_last(regulated: Injector, start: float) -> None:
    points = [OperatingPoint(100e6, pulses, start=start, horizon=15e-6) for pulses in PULSES.values()]
    inputs = plan.prepare(regulated, points, 1e-6).courses.inputs
    times = start + 1e-6 * np.arange(15)
    for name, point, found in zip(PULSES, points, inputs, strict=True):
        expected = [naive_clocks(point, begin, 1e-6) for begin in times.tolist()]
        assert np.array_equal(found[:, 4:], expected), name


def test_the_ring_holds_the_longest_delay(regulated: Injector) -> None:
    theta = population.candidate_matrix(regulated, ("feed_pipe.length",), np.array([[0.1], [2.0]]))
    job = plan.make_job(plan.prepare(regulated, [OperatingPoint(160e6, 1e-3)], 1e-6), theta, True)
    assert job.ring & (job.ring - 1) == 0
    assert job.ring > 2.0 / plan.SLOWEST_WAVE / 1e-6


def test_what_lies_outside_its_domain_is_told(regulated: Injector) -> None:
    values = np.array([[1e-3, 1.0], [-1e-3, 1.0], [1e-3, np.nan], [1e-3, 1.5]])
    inside = population.admissible(("valve.mass", "control_chamber.z_hole_from_inlet"), values)
    assert inside.tolist() == [True, False, False, False]


def test_each_of_several_in_a_domain_is_looked_at() -> None:
    names = ("valve.mass", "plunger_needle.k1", "plunger_needle.k2")
    assert population.admissible(names, 1.5 - np.eye(3)).all()
    assert not population.admissible(names, 1.0 - 2.0 * np.eye(3)).any()


def test_a_traced_drive_needs_its_trace(by_current: Injector) -> None:
    with pytest.raises(ConfigurationError, match="current trace"):
        plan.prepare(by_current, [OperatingPoint(160e6, 1e-3)], 1e-6)


def test_too_many_steps_are_refused(regulated: Injector) -> None:
    with pytest.raises(ConfigurationError, match="steps"):
        plan.prepare(regulated, [OperatingPoint(160e6, 1e-3, horizon=1.0)], 1e-8)


@pytest.mark.parametrize("names", [("valve.mass", "plunger_needle.k3"), ("fuel.temperature", "valve.mass"), ()])
def test_the_injectors_own_row_gives_the_same_candidates(regulated: Injector, names: tuple[str, ...]) -> None:
    values = np.array([[regulated.values[name] for name in names]]) * np.array([[1.0], [0.9], [1.1]])
    prepared = plan.prepare(regulated, [OperatingPoint(160e6, 300e-6)], 1e-6)
    theta = population.candidate_matrix(regulated, names, values)
    assert np.array_equal(population.candidate_matrix(regulated, names, values, prepared.row), theta)
