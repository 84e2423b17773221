"""Virtual benches in short form: what `make coverage` counts over 400 of each kind."""

from __future__ import annotations

import numpy as np
import pytest

from studies.coverage import BEDS, Promise, Row, line, measure_bed, misses


@pytest.fixture(scope="module")
def white() -> Row:
    """Twelve benches with white noise."""
    return measure_bed(BEDS["white"], 12)


def check(found: Row) -> None:
    """Of 36 intervals of 95 %, fewer than 30 hold the truth with a probability of 0.5 %, were they independent.

    With one standard error in place of the t quantile 24.6 of 36 do on average, and 15 where the autocorrelation of 0.9
    is neglected: 30 or more then have a probability of 4 % and of less than 1e-6.
    """
    assert found.every >= 83.0
    # the scatter of 12 estimates is known to 21 %
    assert ((found.widths > 0.5) & (found.widths < 2.0)).all()
    assert found.printed >= 75.0  # 97 % of the searches settle; fewer than 9 of 12 have a probability of 4e-4
    assert found.simulations <= 2500.0


def test_intervals_of_simulated_benches_hold_their_truth(white: Row) -> None:
    check(white)


@pytest.mark.slow  # in `make coverage` too; tests/plugins/certainty/test_draws.py has the law under this noise
def test_intervals_under_autoregressive_noise_hold_the_truth() -> None:
    check(measure_bed(BEDS["autoregressive"], 12))


def test_a_promise_that_is_not_kept_is_told(white: Row) -> None:
    assert misses(white, Promise()) == []
    assert misses(white._replace(every=50.0), Promise(every=(93, 97))) == ["coverage outside 93 to 97"]
    assert misses(white._replace(wrong=8.0), Promise(wrong=7)) == ["wrongly determined outside 0 to 7"]
    assert misses(white._replace(each=np.array([95.0, 80.0])), Promise(each=(90, 99)))
    assert line("white", white).count("|") == 12


def test_a_delay_that_is_not_stated_raises_an_alarm() -> None:
    found = measure_bed(BEDS["unstated delay 5 us, known white"], 3)
    assert found.alarms == 100.0
    assert found.determined == 0.0
