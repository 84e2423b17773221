"""The bed of what `calibrate` writes by itself: its noises are what they say, and its figures count what they say."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from studies.coverage_written import _coverage, main
from studies.noises import ABSOLUTE, NOISES, RELATIVE

RATE = np.concatenate([np.zeros(100_000), np.full(100_000, 40e-6)])  # [m³/s]
INTERVAL, SIGMA = 5e-6, 0.3e-6

# Root mean squares in standard deviations. 200,000 samples scatter by 0.2 %; correlation and tails of Student's t make
# that 1 and 3 %. Outliers: 0.9 + 0.1 · 64; drift: equal to the white part, its window not a whole number of periods.
SIZES = {"white": 1.0, "student": 1.0, "autoregressive": 1.0, "filtered": 1.0, "delay": 1.0, "outliers": np.sqrt(7.3)}


@pytest.mark.parametrize("name", SIZES)
def test_noises_have_the_stated_deviation(name: str) -> None:
    errors = NOISES[name].errors(np.random.default_rng(1), RATE, INTERVAL, SIGMA)
    assert np.sqrt(np.mean(errors**2)) / SIGMA == pytest.approx(SIZES[name], rel=0.05)


def test_filtered_noise_has_the_correlation_of_two_filters() -> None:
    errors = NOISES["filtered"].errors(np.random.default_rng(1), RATE, INTERVAL, SIGMA)
    past = np.exp(-2 * np.pi * 12e3 * INTERVAL)
    weights = np.arange(1, 500) * past ** np.arange(499)  # response of two equal filters
    expected = np.sum(weights[1:] * weights[:-1]) / np.sum(weights**2)
    assert np.corrcoef(errors[1:], errors[:-1])[0, 1] == pytest.approx(expected, abs=0.01)


def test_proportional_noise_grows_with_the_rate() -> None:
    errors = NOISES["proportional"].errors(np.random.default_rng(1), RATE, INTERVAL, SIGMA)
    assert np.std(errors[RATE == 0.0]) == pytest.approx(ABSOLUTE, rel=0.02)
    assert np.std(errors[RATE > 0.0]) == pytest.approx(ABSOLUTE + RELATIVE * 40e-6, rel=0.02)


def test_the_drift_is_slow_and_as_large_as_the_white_noise() -> None:
    draws = [NOISES["drifting"].errors(np.random.default_rng(i), np.zeros(400), INTERVAL, SIGMA) for i in range(400)]
    slow = np.mean(np.reshape(draws, (400, 20, 20)), axis=2)  # of 20 samples, which white noise leaves 0.05 of
    assert np.mean(slow**2) / SIGMA**2 == pytest.approx(1.05, rel=0.1)


def test_coverage_counts_the_finite_intervals() -> None:
    truth, point = np.array([1.0, 2.0]), np.array([[1.1, 2.0], [0.9, 2.5], [1.0, 2.1], [1.2, 1.9]])
    low, high = point - 0.15, point + 0.15
    high[3, 0] = np.inf
    found = _coverage(truth, point, low, high)
    assert found["each"] == pytest.approx([100.0, 75.0])
    assert found["every"] == pytest.approx(100.0 * 6 / 7)
    assert found["refused"] == pytest.approx(12.5)
    assert found["widths"] == pytest.approx((0.15 / 1.96 / np.std(point, axis=0, ddof=1)).tolist())


def test_the_bed_fits_and_writes_its_figures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "found.json"
    assert main(["white", "delay", "--bed", "cri2-16", "-n", "3", "--json", str(file)]) == 0
    rows = json.loads(file.read_text())
    assert [(row["noise"], row["benches"], row["failed"]) for row in rows] == [("white", 3, 0), ("delay", 3, 0)]
    # of 9 intervals of 95 % fewer than 6 hold the truth with a probability of 1e-3
    assert rows[0]["every"] >= 66.0
    assert capsys.readouterr().out.count("\n") == 4
    with pytest.raises(SystemExit):
        main(["pink"])
