"""Longest step: the fastest mode, its damping, and what is said beyond the limit."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh

from commonrail.base.choices import Body
from commonrail.engine import time_step
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.plan import candidate_matrix
from commonrail.engine.simulate import simulate, simulate_batch
from commonrail.engine.status import Status
from commonrail.engine.time_step import (
    Medium,
    longest_step,
    medium_of,
    nice_step,
    step_advice,
    stiffest_corner,
    too_long,
)
from commonrail.physics.injector import Injector, parameter_paths, parameter_quantities
from commonrail.plugins.verification.closed_forms import chain_matrices

POINT = OperatingPoint(160e6, 700e-6)
EMPTY = Medium(0.0, 0.0, 0.0)  # no fuel: its springs and its waves do not count


def own_vector(injector: Injector) -> np.ndarray:
    return np.array([injector.values[path] for path in parameter_paths()])


def drawn(injector: Injector) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cylinder masses; stiffness with stop and seat, and nodal masses, of the chain."""
    p = injector.parameters.plunger_needle
    k, m = np.array([p.k1, p.k2, p.k3, p.k4, p.k5, p.k6, p.k7]), np.array([p.m1, p.m2, p.m3, p.m4, p.m5, p.m6, p.m7])
    matrix, nodes = chain_matrices(k, m, p.joint_stiffness)
    matrix[0, 0] += p.stop_stiffness
    matrix[8, 8] += injector.parameters.needle_seat.contact_stiffness
    return m, matrix, nodes


def growth(injector: Injector, dt: float) -> float:
    """Spectral radius of a leapfrog step with extrapolated dampers, from its 27 × 27 matrix."""
    p = injector.parameters.plunger_needle
    m, stiffness, nodes = drawn(injector)
    k = np.array([p.k1, p.k2, p.k3, p.k4, p.k5, p.k6, p.k7])
    damping, _ = chain_matrices(2.0 * p.damping_ratio * np.sqrt(k * m), m, 0.0)
    a, c, one, none = -stiffness / nodes[:, None], -damping / nodes[:, None], np.eye(9), np.zeros((9, 9))
    # z, v, w → z + dt u, u, v with u = v + dt (a z + c (1.5 v − 0.5 w))
    u = np.hstack([dt * a, one + 1.5 * dt * c, -0.5 * dt * c])
    step = np.vstack([np.hstack([one, none, none]) + dt * u, u, np.hstack([none, one, none])])
    return float(np.abs(np.linalg.eigvals(step)).max())


def test_without_damping_it_is_two_over_the_highest_frequency(regulated: Injector) -> None:
    undamped = regulated.with_values({"plunger_needle.damping_ratio": 0.0})
    _, matrix, nodes = drawn(undamped)
    highest = np.sqrt(eigh(matrix, np.diag(nodes), eigvals_only=True)[-1])
    assert longest_step(undamped, own_vector(undamped), EMPTY) == pytest.approx(2 / highest, rel=1e-10)


@pytest.mark.parametrize("ratio", [0.005, 0.05, 0.3])
def test_with_damping_it_is_where_the_step_begins_to_amplify(regulated: Injector, ratio: float) -> None:
    damped = regulated.with_values({"plunger_needle.damping_ratio": ratio})
    limit = longest_step(damped, own_vector(damped), EMPTY)
    assert growth(damped, 0.999 * limit) <= 1.0 + 1e-9  # rounding of 27 eigenvalues
    assert growth(damped, 1.001 * limit) > 1.0 + 1e-6


def test_a_rigid_body_only_feels_its_contacts(rigid: Injector) -> None:
    p = rigid.parameters
    mass = sum(drawn(rigid)[0])
    stiff = p.plunger_needle.stop_stiffness + p.needle_seat.contact_stiffness
    slow = rigid.with_values({"valve.mass": 1.0})  # the valve's own limit out of the way
    limit = 0.7 * np.sqrt(mass / stiff)  # a third of what is stable, for its accuracy
    assert longest_step(slow, own_vector(slow), EMPTY) == pytest.approx(limit, rel=1e-10)


def test_enclosed_fuel_presses_as_a_spring(rigid: Injector) -> None:
    """K_f A²/V of the control chamber on the plunger's 4.3 mm."""
    small = rigid.with_values({"control_chamber.volume": 1e-12})
    medium = Medium(2.2e9, 0.0, 0.0)
    spring = 2.2e9 * (np.pi / 4 * 4.3e-3**2) ** 2 / 1e-12
    limit = 0.7 * np.sqrt(sum(drawn(rigid)[0]) / spring)
    assert longest_step(small, own_vector(small), medium) == pytest.approx(limit, rel=0.01)  # contacts: 0.1 % of it


def test_an_area_beyond_all_numbers_bears_no_step_and_warns_of_nothing(rigid: Injector) -> None:
    huge = rigid.with_values({"plunger_needle.plunger_diameter": 4.3e297})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert longest_step(huge, own_vector(huge), EMPTY) == 0.0


def test_a_pipe_takes_a_step_at_least(rigid: Injector) -> None:
    short = rigid.with_values({"feed_pipe.length": 1e-4})
    medium = medium_of(rigid, 160e6)
    assert longest_step(short, own_vector(short), medium) == pytest.approx(1e-4 / medium.speed, rel=1e-10)


@pytest.mark.parametrize(
    ("values", "step"),
    [
        ({"plunger_needle.m1": 0.1}, 1e-6),
        ({"plunger_needle.joint_stiffness": 20.0}, 1e-6),
        ({"needle_seat.contact_stiffness": 10.0}, 1e-6),
        ({"valve.mass": 0.01}, 1e-6),
        ({"feed_pipe.length": 0.001}, 1e-6),
        ({}, 3e-6),
    ],
)
def test_beyond_the_limit_no_figure_passes_for_sound(
    regulated: Injector, values: dict[str, float], step: float
) -> None:
    """Factors on the drawing. With m1 × 0.1 the volume was 17 % off under an OK."""
    stiff = regulated.with_values({name: factor * regulated.values[name] for name, factor in values.items()})
    solution = simulate(stiff, POINT, time_step=step)
    assert solution.status is Status.STEP_UNSTABLE
    batch = simulate_batch(stiff, [POINT], time_step=step)
    assert batch.status.tolist() == [[Status.STEP_UNSTABLE]]
    assert np.isnan(batch.injected_mass).all()
    # and the step that the sentence names does
    named = nice_step(solution.longest_step)
    assert f"{named * 1e6:g} us would do" in solution.sentence
    assert simulate(stiff, POINT, time_step=named).status is not Status.STEP_UNSTABLE


def test_a_step_within_the_limit_is_fine(regulated: Injector) -> None:
    assert simulate(regulated, POINT, time_step=1.9e-6).status is Status.OK


def test_each_candidate_has_its_own_limit(regulated: Injector) -> None:
    names = ("plunger_needle.m1", "plunger_needle.k1")
    own = np.array([regulated.values[name] for name in names])
    factors = np.array([[1.0, 1.0], [0.1, 1.0], [1.0, 9.0], [1.2, 1.1]])
    theta = candidate_matrix(regulated, names, own * factors)
    medium = medium_of(regulated, 160e6)
    found = too_long(regulated, names, theta, medium, 1e-6)
    assert found.tolist() == [False, True, True, False]
    alone = [longest_step(regulated, row, medium) < 1e-6 for row in theta]
    assert found.tolist() == alone
    status = simulate_batch(regulated, [POINT], names, own * factors).status[:, 0]
    assert (status == Status.STEP_UNSTABLE).tolist() == alone


@pytest.mark.parametrize("body", Body)
def test_the_limit_moves_as_its_parameters_are_said_to_move_it(regulated: Injector, body: Body) -> None:
    """The stiffest corner of a box relies on it: 40 random injectors, each parameter up by a fifth."""
    injector = replace(regulated, variant=regulated.variant._replace(body=body))
    medium, rng = medium_of(injector, 160e6), np.random.default_rng(4)
    paths = parameter_paths()
    for _ in range(40):
        theta = own_vector(injector) * 2.0 ** rng.uniform(-1, 1, len(paths))
        limit = longest_step(injector, theta, medium)
        for name in (*time_step.SHORTENS, *time_step.LENGTHENS):
            more = theta.copy()
            more[paths.index(name)] *= 1.2
            changed = longest_step(injector, more, medium)
            shortens = name in time_step.SHORTENS
            assert changed <= limit * (1 + 1e-9) if shortens else changed >= limit * (1 - 1e-9), name


def test_no_other_parameter_moves_the_limit(regulated: Injector) -> None:
    medium = medium_of(regulated, 160e6)
    limit = longest_step(regulated, own_vector(regulated), medium)
    for name in set(parameter_paths()) - {*time_step.SHORTENS, *time_step.LENGTHENS}:
        changed = own_vector(regulated)
        changed[parameter_paths().index(name)] *= 3.0
        assert longest_step(regulated, changed, medium) == limit, name


def test_the_stiffest_corner_takes_the_worse_bound_of_each(regulated: Injector) -> None:
    names = ("plunger_needle.k1", "plunger_needle.m1", "valve.spring_preload")
    assert set(names) <= set(parameter_quantities())
    corner = stiffest_corner(regulated.values, dict.fromkeys(names, 1.0), dict.fromkeys(names, 9.0))
    assert (corner[names[0]], corner[names[1]]) == (9.0, 1.0)


def test_round_steps_leave_five_per_cent() -> None:
    assert nice_step(1.96e-6) == 1.5e-6
    assert nice_step(1.06e-6) == 1e-6
    assert nice_step(1.05e-6) == 7.5e-7
    assert nice_step(0.0) == 0.0
    assert "0.5 us" in step_advice(5.4e-7)
    assert "No step" in step_advice(1e-12)
