"""Longest step: the frequency of the stiffest mode, and what happens beyond it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import eigh

from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.simulate import simulate
from commonrail.engine.stability import chain_matrices, longest_step
from commonrail.engine.status import Status
from commonrail.injector.definition import Injector, parameter_paths


def own_vector(injector: Injector) -> np.ndarray:
    return np.array([injector.values[path] for path in parameter_paths()])


def test_matrices_of_the_chain() -> None:
    k, m = np.arange(1.0, 8.0), np.arange(1.0, 8.0)
    matrix, nodes = chain_matrices(k, m, 50.0)
    z = np.random.default_rng(1).normal(size=9)
    springs = [*k[:5], 50.0, *k[5:]]
    energy = 0.5 * sum(s * (z[i] - z[i + 1]) ** 2 for i, s in enumerate(springs))
    assert 0.5 * z @ matrix @ z == pytest.approx(energy, rel=1e-13)
    assert nodes.tolist() == [0.5, 1.5, 2.5, 3.5, 4.5, 2.5, 3.0, 6.5, 3.5]


def test_longest_step_is_two_over_the_highest_frequency(regulated: Injector) -> None:
    p = regulated.parameters.plunger_needle
    k, m = np.array([p.k1, p.k2, p.k3, p.k4, p.k5, p.k6, p.k7]), np.array([p.m1, p.m2, p.m3, p.m4, p.m5, p.m6, p.m7])
    matrix, nodes = chain_matrices(k, m, p.joint_stiffness)
    matrix[0, 0] += p.stop_stiffness
    matrix[8, 8] += regulated.parameters.needle_seat.contact_stiffness
    highest = np.sqrt(eigh(matrix, np.diag(nodes), eigvals_only=True)[-1])
    assert longest_step(regulated, own_vector(regulated)) == pytest.approx(2 / highest, rel=1e-10)


def test_a_rigid_body_only_feels_its_contacts(rigid: Injector) -> None:
    p = rigid.parameters.plunger_needle
    mass = p.m1 + p.m2 + p.m3 + p.m4 + p.m5 + p.m6 + p.m7
    assert longest_step(rigid, own_vector(rigid)) == pytest.approx(2 * np.sqrt(mass / 2e8), rel=1e-12)


def test_a_step_beyond_the_limit_ends_in_a_named_status(regulated: Injector) -> None:
    assert longest_step(regulated, own_vector(regulated)) < 3e-6
    solution = simulate(regulated, OperatingPoint(160e6, 700e-6), time_step=3e-6)
    assert solution.status is Status.STEP_UNSTABLE
    assert "shorter time step" in solution.status.sentence


def test_a_step_within_the_limit_is_fine(regulated: Injector) -> None:
    assert simulate(regulated, OperatingPoint(160e6, 700e-6), time_step=2e-6).status is Status.OK
