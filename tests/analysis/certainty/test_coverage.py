"""Virtual benches in short form: what `make coverage` counts over 400 of each kind."""

from __future__ import annotations

import numpy as np
import pytest

from tools.coverage import BEDS, Promise, Row, line, misses, row


@pytest.fixture(scope="module")
def white() -> Row:
    """Twelve benches with white noise."""
    return row(BEDS["white"], 12)


def test_intervals_of_simulated_benches_hold_their_truth(white: Row) -> None:
    """Of 36 intervals of 95 %, fewer than 30 hold the truth with a probability of 0.5 %, were they independent."""
    assert white.every >= 83.0
    # the scatter of 12 estimates is known to 21 %
    assert ((white.widths > 0.5) & (white.widths < 2.0)).all()
    assert white.simulations <= 600.0


def test_a_promise_that_is_not_kept_is_told(white: Row) -> None:
    assert misses(white, Promise()) == []
    assert misses(white._replace(every=50.0), Promise(every=(93, 97))) == ["coverage outside 93 to 97"]
    assert misses(white._replace(wrong=8.0), Promise(wrong=7)) == ["wrongly pinned outside 0 to 7"]
    assert misses(white._replace(each=np.array([95.0, 80.0])), Promise(each=(90, 99)))
    assert line("white", white).count("|") == 12


def test_a_delay_that_nobody_states_raises_an_alarm() -> None:
    found = row(BEDS["unstated delay 5 us, known white"], 3)
    assert found.alarms == 100.0
    assert found.pinned == 0.0
