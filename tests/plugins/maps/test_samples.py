"""Samples of a map: the times that are simulated, and the places where the quantity falls."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.plugins.maps.axes import ENERGISING_TIMES
from commonrail.plugins.maps.response import FINE, FINE_UNTIL, Line, Response, find_falls, sample_times

MM3, US = 1e-9, 1e-6


def line(times: list[float], volumes: list[float]) -> Line:
    """Line at 80 MPa of times [us] and volumes [mm³]."""
    time, volume = np.array(times) * US, np.array(volumes) * MM3
    return Line(80e6, time, volume, np.zeros(len(time)))


def test_the_times_of_the_axis_are_among_those_that_are_simulated() -> None:
    times = np.array(ENERGISING_TIMES)
    knots = sample_times(times)
    assert set(times.tolist()) <= set(knots.tolist())
    assert np.all(np.diff(knots) > 0.0)
    assert knots[-1] == times[-1]


def test_a_fall_of_some_tens_of_microseconds_cannot_hide_between_the_times() -> None:
    knots = sample_times(np.array([2e-3]))
    assert np.diff(knots[knots <= FINE_UNTIL]).max() <= FINE * 1.001


@pytest.mark.parametrize(
    ("volumes", "falls"),
    [
        ([0, 1, 2, 3, 4], []),
        ([0, 0, 0, 1, 1], []),  # a flat is no fall
        ([0, 2, 1, 3, 4], [(20, 30, 2, 1)]),
        ([0, 3, 2, 1, 4], [(20, 40, 3, 1)]),  # one fall of several steps
        ([0, 2, 1, 3, 2], [(20, 30, 2, 1), (40, 50, 3, 2)]),  # the last one without a rise behind it
        ([0, 1, 0.995, 2, 3], []),  # below the smallest that is named
        ([0, 3, 1, 2, 0.5], [(20, 30, 3, 1), (40, 50, 2, 0.5)]),
        ([0, 2, np.nan, 1, 3], [(20, 40, 2, 1)]),  # a failed simulation in between
    ],
)
def test_falls_are_found_from_their_largest_to_their_smallest_quantity(
    volumes: list[float], falls: list[tuple[float, ...]]
) -> None:
    found = [
        (f.start / US, f.end / US, f.high / MM3, f.low / MM3) for f in find_falls(line([10, 20, 30, 40, 50], volumes))
    ]
    assert [pytest.approx(f) for f in falls] == found


def test_joined_samples_are_sorted() -> None:
    joined = line([10, 30], [1, 3]).add_samples(np.array([20 * US]), Response(np.array([2 * MM3]), np.array([1e-4])))
    assert joined.time.tolist() == pytest.approx([10 * US, 20 * US, 30 * US])
    assert joined.volume.tolist() == pytest.approx([1 * MM3, 2 * MM3, 3 * MM3])
    assert joined.at(np.array([20 * US])).lift.tolist() == [1e-4]
