"""Inverse of a map, against quantities whose inverse is known in closed form."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from commonrail.plugins.maps.choices import Beyond, CellState, Several
from commonrail.plugins.maps.inverse import NARROWEST, TOLERANCE, Inverse, Rules, invert
from commonrail.plugins.maps.response import Line, Response, sample_times

Floats = NDArray[np.float64]
Law = Callable[[Floats, Floats], Floats]

MM3, US = 1e-9, 1e-6
LONGEST = 1e-3


def found(
    law: Law, quantity: list[float], rules: Rules = Rules(), rail: float = 100e6
) -> tuple[Inverse, list[Line], int]:
    """Inverse of a law of rail pressure [Pa] and time [s] at quantities [mm³], its samples, and how many it took."""
    count = 0

    def simulate(rows: NDArray[np.intp], times: Floats) -> Response:
        nonlocal count
        count += times.size
        return Response(law(np.full(len(rows), rail), times), np.zeros(times.shape))

    times = sample_times(np.array([LONGEST]))
    rails = np.full(len(times), rail)
    lines = [Line(rail, times, law(rails, times), np.zeros(len(times)))]
    result, lines = invert(simulate, lines, np.array(quantity) * MM3, rules)
    return result, lines, count


def smooth(rail: Floats, time: Floats) -> Floats:
    """Zero up to 200 us, then a parabola: 100 (t − 0.2 ms)² mm³ at 100 MPa."""
    return np.asarray(rail / 100e6 * 100.0 * MM3 * (np.maximum(time - 200 * US, 0.0) * 1e3) ** 2)


def test_the_inverse_of_a_smooth_law_is_that_of_the_closed_form() -> None:
    quantity = [0.5, 1.0, 5.0, 20.0, 60.0]
    result, _, count = found(smooth, quantity)
    exact = 200 * US + np.sqrt(np.array(quantity) / 100.0) * 1e-3
    slope = 2.0 * 100.0 * MM3 * (exact - 200 * US) * 1e6
    assert np.all(np.abs(result.energising_time[0] - exact) <= TOLERANCE / slope * 1.001)
    assert set(result.state[0].tolist()) == {CellState.REACHED}
    assert np.all(np.abs(result.delivered[0] / MM3 - quantity) <= TOLERANCE / MM3)
    assert count <= 3 * len(quantity)  # a chord and the parabola through three points


def test_no_quantity_needs_no_time() -> None:
    result, _, count = found(smooth, [0.0])
    assert (result.energising_time[0, 0], result.state[0, 0], count) == (0.0, CellState.ZERO, 0)


def test_an_unreachable_quantity_follows_the_stated_rule() -> None:
    """The law is a straight line behind its end: extrapolation is exact there."""

    def line(_: Floats, time: Floats) -> Floats:
        return np.asarray(50.0 * MM3 * np.maximum(time - 200 * US, 0.0) * 1e3)  # 40 mm³ at 1 ms

    times = {}
    for rule in Beyond:
        result, _, count = found(line, [80.0], Rules(beyond=rule))
        assert (result.state[0, 0], count) == (CellState.BEYOND, 0)
        times[rule] = result.energising_time[0, 0]
    assert times[Beyond.EXTRAPOLATE] == pytest.approx(1.8e-3)
    assert times[Beyond.HOLD] == LONGEST
    assert np.isnan(times[Beyond.EMPTY])


def folded(_: Floats, time: Floats) -> Floats:
    """Rises to 4 mm³ at 300 us, falls to 2 mm³ at 350 us, rises again, all in straight lines."""
    knots = np.array([0.0, 200.0, 300.0, 350.0, 1000.0]) * US
    return np.interp(time, knots, np.array([0.0, 0.0, 4.0, 2.0, 28.0]) * MM3)


@pytest.mark.parametrize(("rule", "time"), [(Several.SHORTEST, 275.0), (Several.LONGEST, 375.0)])
def test_of_several_times_the_rule_takes_one_and_the_cell_is_named(rule: Several, time: float) -> None:
    result, _, _ = found(folded, [1.0, 3.0, 10.0], Rules(several=rule))
    assert result.energising_time[0, 1] == pytest.approx(time * US, abs=0.26 * US)  # 0.01 mm³ over 0.04 mm³/us
    assert result.state[0].tolist() == [CellState.REACHED, CellState.SEVERAL, CellState.REACHED]


QUANTITIES = [1.0, 2.5, 3.0, 3.5, 6.0]
RAILS = np.array([80e6, 100e6, 120e6])


def beside(offset: float) -> Law:
    """The folded law at 100 MPa; at the pressures next to it a line of 0.04 mm³/us that begins at an offset [us]."""

    def law(rail: Floats, time: Floats) -> Floats:
        plain = 0.04 * MM3 * np.maximum(time / US - offset, 0.0)
        return np.where(rail == 100e6, folded(rail, time), plain)

    return law


def inverse_of(law: Law, rails: Floats, rules: Rules) -> Inverse:
    times = sample_times(np.array([LONGEST]))
    lines = [Line(rail, times, law(np.full(len(times), rail), times), np.zeros(len(times))) for rail in rails.tolist()]

    def simulate(rows: NDArray[np.intp], times: Floats) -> Response:
        return Response(law(rails[rows], times), np.zeros(times.shape))

    return invert(simulate, lines, np.array(QUANTITIES) * MM3, rules)[0]


@pytest.mark.parametrize(("offset", "branch"), [(200.0, Several.SHORTEST), (295.0, Several.LONGEST)])
def test_of_several_times_that_of_the_neighbours_is_taken(offset: float, branch: Several) -> None:
    law = beside(offset)
    taken = inverse_of(law, RAILS, Rules()).energising_time
    assert taken == pytest.approx(inverse_of(law, RAILS, Rules(several=branch)).energising_time)
    assert np.all(np.diff(taken, axis=1) > 0.0)


def test_lines_of_another_map_are_no_neighbours() -> None:
    """Pressures that do not increase begin another map, as those of another dwell do."""
    alone, apart, together = (
        inverse_of(beside(200.0), np.array([*others, 100e6]), Rules()).energising_time[-1]
        for others in ([], [120e6], [80e6])
    )
    assert apart.tolist() == alone.tolist() != together.tolist()


def test_a_quantity_that_is_jumped_past_is_named_and_its_time_is_behind_the_jump() -> None:
    def jumping(_: Floats, time: Floats) -> Floats:
        return np.where(time < 233.3 * US, 0.0, 2.0 * MM3 + (time - 233.3 * US) * 1e-5)

    result, _, _ = found(jumping, [1.0, 2.5])
    assert result.state[0].tolist() == [CellState.JUMP, CellState.REACHED]
    assert 0.0 <= result.energising_time[0, 0] - 233.3 * US <= NARROWEST
    assert result.delivered[0, 0] == pytest.approx(2.0 * MM3, rel=1e-3)


def test_a_row_without_a_sound_simulation_has_no_numbers() -> None:
    result, _, _ = found(lambda _, time: np.full(time.shape, np.nan), [0.0, 1.0])
    assert result.state[0].tolist() == [CellState.ZERO, CellState.FAILED]
    assert np.isnan(result.energising_time[0, 1])


def test_a_simulation_that_fails_during_the_search_ends_its_cell_alone() -> None:
    def torn(rail: Floats, time: Floats) -> Floats:
        on_grid = np.isin(time, sample_times(np.array([LONGEST])))
        failing = (time > 290 * US) & (time < 310 * US) & ~on_grid
        return np.where(failing, np.nan, smooth(rail, time))

    result, _, _ = found(torn, [1.05, 5.0])
    assert result.state[0].tolist() == [CellState.FAILED, CellState.REACHED]


def test_energising_times_rise_with_the_quantity_even_across_a_fold() -> None:
    quantity = np.linspace(0.1, 35.0, 60).tolist()
    for rule in Several:
        result, _, _ = found(folded, quantity, Rules(several=rule))
        assert np.all(np.diff(result.energising_time[0]) > 0.0)


def test_samples_of_the_search_join_those_of_the_grid() -> None:
    _, lines, count = found(smooth, [5.0])
    assert len(lines[0].time) == len(sample_times(np.array([LONGEST]))) + count
    assert np.all(np.diff(lines[0].time) >= 0.0)
