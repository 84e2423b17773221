"""Chain of nine masses: its modes against a generalised eigenproblem, its statics against a linear solve."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import eigh

from commonrail.physics.components import plunger_needle
from commonrail.physics.components.plunger_needle import Loads, Nine, SeatContact, State
from commonrail.physics.injector import Injector

Floats = NDArray[np.float64]

FREE = Loads(0.0, 0.0, 0.0, 0.0, 0.0)
STILL = Nine(*[0.0] * 9)
SEAT = SeatContact(2e8, 0.0)
K = np.array([1.22e8, 8.08e7, 8.21e7, 9.44e7, 9.43e7, 1.86e8, 5.82e7])  # Table 1
JOINT = 1e8
DT = 1e-6  # [s]


@pytest.fixture(scope="module")
def drawn(regulated: Injector) -> plunger_needle.Parameters:
    """The drawing without damping and needle spring, and with its upper stop out of reach."""
    return regulated.parameters.plunger_needle._replace(damping_ratio=0.0, spring_stiffness=0.0, stop_lift=1.0)


@pytest.fixture(scope="module")
def chain(drawn: plunger_needle.Parameters) -> plunger_needle.Coefficients:
    return plunger_needle.coefficients(drawn, DT)


def nodal(masses: Floats) -> Floats:
    """An inner mass takes half of each neighbour, an end mass half of its one."""
    return np.append(masses, 0.0) / 2 + np.append(0.0, masses) / 2


def springs(k: Floats) -> Floats:
    """Stiffness matrix of a free chain."""
    matrix = np.zeros((len(k) + 1, len(k) + 1))
    for i, stiffness in enumerate(k):
        matrix[i : i + 2, i : i + 2] += stiffness * np.array([[1.0, -1.0], [-1.0, 1.0]])
    return matrix


def masses_of(p: plunger_needle.Parameters) -> Floats:
    return np.array([p.m1, p.m2, p.m3, p.m4, p.m5, p.m6, p.m7])


def ringing(
    drawn: plunger_needle.Parameters,
    load: Loads,
    rest: Floats,
    shape: Floats,
    mass: Floats,
    period: float,
    steps: int = 200,
) -> float:
    """Angular frequency of a small modal amplitude under `advance`, from its zero crossings over ten periods."""
    dt = period / steps  # leapfrog errs by (ω dt)²/24, 4e-5 with 200 steps
    c = plunger_needle.coefficients(drawn, dt)
    amplitude = 1e-8 * shape / np.abs(shape).max()
    start = -0.5 * dt * (-((2 * np.pi / period) ** 2) * amplitude)
    s = State(Nine(*(rest + amplitude)), Nine(*start), Nine(*[0.0] * 9))
    course = []
    for _ in range(10 * steps):
        course.append((np.array(s.z) - rest) @ (mass * shape))
        s = plunger_needle.advance(c, SEAT, s, load, dt)
    q = np.array(course)
    at = np.flatnonzero(q[:-1] * q[1:] < 0.0)
    crossings = at + q[at] / (q[at] - q[at + 1])
    return float(np.pi * (len(crossings) - 1) / ((crossings[-1] - crossings[0]) * dt))


# a plunger far from its needle, and a needle far from its seat: every contact is open
APART = np.array([2e-3] * 6 + [1e-3] * 3)


@pytest.mark.parametrize("mode", range(1, 6))
def test_free_plunger_rings_at_its_eigenfrequencies(drawn: plunger_needle.Parameters, mode: int) -> None:
    mass = nodal(masses_of(drawn)[:5])
    squares, shapes = eigh(springs(K[:5]), np.diag(mass))
    omega = np.sqrt(squares[mode])
    shape, weight = np.zeros(9), np.zeros(9)
    shape[:6], weight[:6] = shapes[:, mode], mass
    measured = ringing(drawn, FREE, APART, shape, weight, 2 * np.pi / omega)
    # 0.1 %: leapfrog 0.004 %, the rest is rounding of 1e-8 m on 1e-3 m in the crossings
    assert measured == pytest.approx(omega, rel=1e-3)


# Errors as above; with 20 steps a period leapfrog alone errs by (ω dt)²/24 = 0.41 %, with its correction by some
# (ω dt)⁴/1000: it is of fourth order.
@pytest.mark.parametrize(("steps", "error"), [(200, 1e-3), (20, 5e-4)])
@pytest.mark.parametrize("mode", range(1, 3))
def test_free_needle_rings_at_its_eigenfrequencies(
    drawn: plunger_needle.Parameters, mode: int, steps: int, error: float
) -> None:
    mass = nodal(masses_of(drawn)[5:])
    squares, shapes = eigh(springs(K[5:]), np.diag(mass))
    omega = np.sqrt(squares[mode])
    shape, weight = np.zeros(9), np.zeros(9)
    shape[6:], weight[6:] = shapes[:, mode], mass
    measured = ringing(drawn, FREE, APART, shape, weight, 2 * np.pi / omega, steps)
    assert measured == pytest.approx(omega, rel=error)


@pytest.mark.parametrize("mode", range(1, 4))
def test_free_plunger_rings_at_its_eigenfrequencies_with_few_steps(drawn: plunger_needle.Parameters, mode: int) -> None:
    mass = nodal(masses_of(drawn)[:5])
    squares, shapes = eigh(springs(K[:5]), np.diag(mass))
    omega = np.sqrt(squares[mode])
    shape, weight = np.zeros(9), np.zeros(9)
    shape[:6], weight[:6] = shapes[:, mode], mass
    measured = ringing(drawn, FREE, APART, shape, weight, 2 * np.pi / omega, 20)
    assert measured == pytest.approx(omega, rel=5e-4)  # as above


@pytest.mark.parametrize("mode", range(9))
def test_pressed_chain_rings_with_joint_and_seat_as_springs(
    chain: plunger_needle.Coefficients, drawn: plunger_needle.Parameters, mode: int
) -> None:
    load = Loads(-2000.0, 0.0, 0.0, 0.0, 0.0)
    masses = masses_of(drawn)
    mass = np.concatenate((nodal(masses[:5]), nodal(masses[5:])))
    stiffness = springs(np.array([*K[:5], JOINT, *K[5:]]))
    stiffness[8, 8] += SEAT.stiffness
    squares, shapes = eigh(stiffness, np.diag(mass))
    omega = np.sqrt(squares[mode])
    rest = np.array(plunger_needle.at_rest(chain, SEAT, load).z)
    measured = ringing(drawn, load, rest, shapes[:, mode], mass, 2 * np.pi / omega)
    assert measured == pytest.approx(omega, rel=1e-3)  # as above


LOAD = Loads(-2300.0, 7.0, -36.0, 1100.0, 420.0)


def test_statics_solve_the_linear_system(drawn: plunger_needle.Parameters) -> None:
    c = plunger_needle.coefficients(drawn._replace(spring_stiffness=35e3), DT)
    stiffness = springs(np.array([*K[:5], JOINT, *K[5:]]))
    stiffness[6, 6] += 35e3
    stiffness[8, 8] += SEAT.stiffness
    force = np.array([LOAD.top, 0, 0, 0, 0, LOAD.foot, LOAD.head, LOAD.shoulder, LOAD.tip])
    # condition number of the chain about 1e2
    assert plunger_needle.at_rest(c, SEAT, LOAD).z == pytest.approx(np.linalg.solve(stiffness, force), rel=1e-11)


def test_an_end_load_shortens_plunger_and_needle_by_force_over_stiffness(chain: plunger_needle.Coefficients) -> None:
    force = 2000.0
    z = plunger_needle.at_rest(chain, SEAT, Loads(-force, 0.0, 0.0, 0.0, 0.0)).z
    assert z.i9 - z.i1 == pytest.approx(force * (np.sum(1 / K) + 1 / JOINT), rel=1e-12)
    assert -z.i9 == pytest.approx(force / SEAT.stiffness, rel=1e-12)


def test_rest_is_rest(drawn: plunger_needle.Parameters) -> None:
    c = plunger_needle.coefficients(drawn._replace(spring_stiffness=35e3, damping_ratio=0.005), DT)
    start = s = plunger_needle.at_rest(c, SEAT, LOAD)
    for _ in range(500):
        s = plunger_needle.advance(c, SEAT, s, LOAD, 1e-6)
    # rounding: 2300 N held to 1e-13 N moves a spring of 6e7 N/m by 1e-20 m, 500 times
    assert np.abs(np.subtract(s.z, start.z)).max() < 1e-16


def test_accelerations_vanish_at_rest_and_agree_with_the_step(drawn: plunger_needle.Parameters) -> None:
    c = plunger_needle.coefficients(drawn._replace(spring_stiffness=35e3, damping_ratio=0.005), DT)
    rest = plunger_needle.at_rest(c, SEAT, LOAD)
    # the greatest spring force of 2300 N on 0.3 g, to rounding
    assert np.abs(plunger_needle.accelerations(c, SEAT, rest.z, STILL, LOAD)).max() < 1e-5
    bent = Nine(*(np.array(rest.z) * 1.1))
    dt = 1e-10  # the correction of fourth order is about (ω dt)²/12: 1e-9 at 1e6/s
    c = plunger_needle.coefficients(drawn._replace(spring_stiffness=35e3, damping_ratio=0.005), dt)
    s = plunger_needle.advance(c, SEAT, State(bent, STILL, STILL), LOAD, dt)
    a = plunger_needle.accelerations(c, SEAT, bent, STILL, LOAD)
    # masses that pull alike from both sides have none of their own
    assert np.array(s.v) / dt == pytest.approx(np.array(a), rel=1e-7, abs=1e-9 * np.abs(a).max())


def test_dampers_follow_their_law(drawn: plunger_needle.Parameters) -> None:
    # c = 2 ξ sqrt(k M) = 0.01 sqrt(k M) at ξ = 0.005, text below Eq. (8)
    c = plunger_needle.coefficients(drawn._replace(damping_ratio=0.005), DT)
    assert c.c == pytest.approx(0.01 * np.sqrt(K * masses_of(drawn)), rel=1e-12)


def test_springs_and_dampers_are_inner_forces(drawn: plunger_needle.Parameters) -> None:
    c = plunger_needle.coefficients(drawn._replace(damping_ratio=0.005), DT)
    rng = np.random.default_rng(5)
    z, v = Nine(*rng.normal(0, 1e-5, 9)), Nine(*rng.normal(0, 1.0, 9))
    forces = np.array(plunger_needle.forces(c, z, v, FREE))
    # sums of a few thousand newtons, to rounding
    assert abs(forces.sum()) < 1e-9
    # friction between masses only takes power
    still = np.array(plunger_needle.forces(c, z, STILL, FREE))
    assert (forces - still) @ np.array(v) < 0.0


def test_a_plunger_leaves_its_needle(chain: plunger_needle.Coefficients) -> None:
    apart = plunger_needle.forces(chain, Nine(*APART), STILL, FREE)
    assert apart == STILL
    touching = APART.copy()
    touching[:6] = APART[6] - 1e-6  # the plunger one micron into its needle
    f = plunger_needle.forces(chain, Nine(*touching), STILL, FREE)
    assert f.i6 == pytest.approx(JOINT * 1e-6, rel=1e-9)
    assert f.i7 == -f.i6


def test_upper_stop_holds_the_top(chain: plunger_needle.Coefficients) -> None:
    low = chain._replace(guides=chain.guides._replace(stop_lift=1e-4))
    lifted = Nine(*np.full(9, 1.1e-4))
    a = plunger_needle.accelerations(low, SEAT, lifted, STILL, FREE)
    assert a.i1 == pytest.approx(-low.guides.stop_stiffness * 1e-5 * low.per_mass.i1, rel=1e-9)
    assert a.i2 == 0.0


def test_loads_are_pressure_on_every_area_normal_to_the_axis(chain: plunger_needle.Coefficients) -> None:
    # plunger 4.3 mm, guide 4.0 mm, stem 2.7 mm, seat 2.0 mm
    seat = np.pi * 1e-6
    f = plunger_needle.loads(chain.guides, seat, 150e6, 155e6, 90e6, 0.5e6)
    quarter = np.pi / 4 * 1e-6
    assert f.top == pytest.approx(-150e6 * quarter * 4.3**2, rel=1e-12)
    assert f.foot == pytest.approx(0.5e6 * quarter * 4.3**2, rel=1e-12)
    assert f.head == pytest.approx(-0.5e6 * quarter * 16.0 - 30.0, rel=1e-12)
    assert f.shoulder == pytest.approx(155e6 * quarter * (16.0 - 2.7**2), rel=1e-12)
    assert f.tip == pytest.approx(155e6 * quarter * (2.7**2 - 4.0) + 90e6 * quarter * 4.0, rel=1e-12)


def test_equal_pressure_everywhere_leaves_area_difference_and_spring(chain: plunger_needle.Coefficients) -> None:
    f = plunger_needle.loads(chain.guides, np.pi * 1e-6, 1e6, 1e6, 1e6, 1e6)
    assert sum(f) == pytest.approx(-30.0, rel=1e-9)


def test_cylinder_stiffness_and_mass() -> None:
    # Eq. (8) by hand: 210 GPa · π/4 · (4 mm)² / 20 mm = 1.31947e8 N/m; steel 7850 kg/m³: 1.97292 g
    assert plunger_needle.cylinder_stiffness(210e9, 4e-3, 20e-3) == pytest.approx(1.31947e8, rel=1e-5)
    assert plunger_needle.cylinder_mass(7850.0, 4e-3, 20e-3) == pytest.approx(1.97292e-3, rel=1e-5)
