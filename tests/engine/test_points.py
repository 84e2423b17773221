"""Operating points side by side in the lanes: the figures of each are those that it has alone, to the last bit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from commonrail.engine.operating_point import OperatingPoint, Trace
from commonrail.engine.plan import prepare
from commonrail.engine.simulate import simulate_batch
from commonrail.engine.solution import Batch
from commonrail.engine.status import Status
from commonrail.engine.time_step import longest_step, medium_of
from commonrail.physics.injector import Injector

FIGURES = (
    "injected_mass",
    "returned_mass",
    "opening",
    "closing",
    "first_closing",
    "greatest_lift",
    "reference_density",
    "status",
)
WAVE = Trace.of(np.linspace(-50e-6, 2e-3, 300), 120e6 + 4e6 * np.sin(np.linspace(0.0, 20.0, 300)))
GAS = Trace.of([0.0, 1e-3], [4e6, 7e6])
# more than a block: lengths, pressures, energisings and starts differ, pressures change, two inject nothing
POINTS = [
    OperatingPoint(160e6, 300e-6),
    OperatingPoint(60e6, 500e-6, horizon=1.2e-3),
    OperatingPoint(WAVE, 250e-6, GAS),
    OperatingPoint(100e6, [(0.0, 180e-6), (700.3e-6, 200e-6), (1100.7e-6, 90e-6)]),
    OperatingPoint(100e6, [(0.0, 150e-6), (150.4e-6, 120e-6)]),
    OperatingPoint(120e6, 200e-6, start=-20e-6),
    OperatingPoint(140e6, [], horizon=300e-6),
    OperatingPoint(80e6, 30e-6, 9e6, 0.2e6),
    OperatingPoint(180e6, 700e-6, horizon=600e-6),  # still injects
    OperatingPoint(40e6, 400e-6),
    OperatingPoint(90e6, [(10e-6, 350e-6)], start=-20e-6),
]


def columns(batch: Batch, chosen: slice) -> dict[str, np.ndarray]:
    return {name: getattr(batch, name)[:, chosen] for name in FIGURES}


def same(one: dict[str, np.ndarray], other: dict[str, np.ndarray], what: str = "") -> None:
    for name, figures in one.items():
        assert np.array_equal(figures, other[name], equal_nan=True), f"{what} {name}"


@pytest.mark.parametrize("ends_early", [True, False])
def test_a_point_among_others_has_the_bits_that_it_has_alone(regulated: Injector, ends_early: bool) -> None:
    together = simulate_batch(regulated, POINTS, stop_when_closed=ends_early, threads=2)
    for i, point in enumerate(POINTS):
        alone = simulate_batch(regulated, [point], stop_when_closed=ends_early, threads=1)
        same(columns(together, slice(i, i + 1)), columns(alone, slice(None)), f"point {i}")
    assert len(np.unique(together.injected_mass)) == len(POINTS) - 1  # two inject nothing
    assert together.status[0, 8] == Status.STILL_INJECTING


def test_points_and_candidates_fill_the_lanes_together(regulated: Injector) -> None:
    """Candidates with delays of their own, so that lanes read their waves from different slots."""
    names = ("feed_pipe.length", "fuel.temperature", "nozzle.hole_diameter")
    own = np.array([regulated.values[name] for name in names])
    values = own * np.array([[1.0, 1.0, 1.0], [1.4, 1.02, 0.95], [0.8, 0.99, 1.05]])
    together = simulate_batch(regulated, POINTS[:5], names, values)
    for i, point in enumerate(POINTS[:5]):
        for k in range(3):
            alone = simulate_batch(regulated, [point], names, values[k : k + 1])
            for name in FIGURES:
                assert getattr(together, name)[k, i] == getattr(alone, name)[0, 0], (name, i, k)


def test_the_order_of_the_points_is_that_of_the_figures(regulated: Injector) -> None:
    forth, back = simulate_batch(regulated, POINTS), simulate_batch(regulated, POINTS[::-1])
    same(columns(forth, slice(None)), columns(back, slice(None, None, -1)))


def test_a_step_that_is_too_long_at_one_point_fails_that_one_alone(regulated: Injector) -> None:
    """The feed pipe is so short that only the slow waves of low pressures need a whole step for it."""
    rails = np.array([30e6, 180e6, 60e6, 170e6, 50e6, 40e6, 55e6, 45e6, 35e6, 65e6])
    between = 0.5 * sum(medium_of(regulated, rail).speed for rail in (65e6, 170e6)) * 1e-6
    short = regulated.with_values({"feed_pipe.length": between})
    points = [OperatingPoint(rail, 150e-6, horizon=400e-6) for rail in rails.tolist()]
    row = prepare(short, points, 1e-6).row
    found = simulate_batch(short, points)
    bears = [longest_step(short, row, medium_of(short, rail)) >= 1e-6 for rail in rails.tolist()]
    assert (found.status[0] != Status.STEP_UNSTABLE).tolist() == bears == (rails < 100e6).tolist()
    assert np.isnan(found.injected_mass[0]).tolist() == (rails > 100e6).tolist()
    sound = [p for p, well in zip(points, bears, strict=True) if well]
    alone = simulate_batch(short, sound)
    for name in FIGURES:
        assert np.array_equal(getattr(found, name)[0, bears], getattr(alone, name)[0], equal_nan=True), name


def test_a_point_that_another_takes_the_place_of_touches_no_neighbour(regulated: Injector) -> None:
    points = [OperatingPoint(100e6 + 1e6 * i, 200e-6) for i in range(10)]
    changed = [*points[:4], replace(points[4], energisings=400e-6), *points[5:]]
    first, second = (columns(simulate_batch(regulated, its, threads=1), slice(None)) for its in (points, changed))
    others = [i for i in range(10) if i != 4]
    for name in FIGURES:
        assert np.array_equal(first[name][0, others], second[name][0, others], equal_nan=True), name
    assert second["injected_mass"][0, 4] > 2.0 * first["injected_mass"][0, 4]
