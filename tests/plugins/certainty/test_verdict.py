"""Verdicts in words, and the tests for lack of fit that withdraw them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from commonrail.calibration.identifiability import ParameterVerdict
from commonrail.calibration.parameter import Prior
from commonrail.calibration.space import Space
from commonrail.data.noise import Correlation, Law, Noise
from commonrail.plugins.certainty.estimate import Estimate
from commonrail.plugins.certainty.lack_of_fit import FIXED, lack_of_fit, withdrawal
from commonrail.plugins.certainty.likelihood import Likelihood
from commonrail.plugins.certainty.noise_fit import Block
from commonrail.plugins.certainty.verdict import Assessment, verdicts_of
from tests.plugins.certainty.linear import TRUTH, Floats, N, design, fitted, interval, likelihood, space

STATED = Noise(law=Law.GAUSSIAN, correlation=Correlation.WHITE)


def curve(seed: int, more: Floats | float = 0.0) -> Floats:
    return np.asarray(design() @ TRUTH + more + 0.2 * np.random.default_rng(seed).standard_normal(N))


def judged(found: Estimate, limit: float = 0.1) -> list[Assessment]:
    d = len(found.unit)
    variances = np.diag(found.covariance.noise)
    correlation = found.covariance.noise / np.sqrt(np.outer(variances, variances))
    return verdicts_of(found, d, interval(found), correlation, withdrawal(found, lack_of_fit(found, d)), limit=limit)


def test_a_narrow_interval_pins_and_a_stricter_limit_does_not() -> None:
    found = fitted(likelihood([curve(1)], [design()], [STATED]))
    assert [one.verdict for one in judged(found)] == [ParameterVerdict.DETERMINED] * 3
    assert "determined to" in judged(found)[0].sentence
    assert all(one.verdict is ParameterVerdict.INSENSITIVE for one in judged(found, 1e-4))
    assert all(one.cure for one in judged(found, 1e-4))


@pytest.mark.parametrize("source", ["bounds", "prior"])
def test_an_interval_that_was_known_before_is_not_determined_by_the_data(source: str) -> None:
    """Each is narrow: bounds of ± 5 %, or a prior of ± 2 %, and data that hardly depend on the parameter."""
    x = design()
    x[:, 1] *= 1e-3
    parameters = list(space().parameters)
    narrow = {"lower": 2.85, "upper": 3.15} if source == "bounds" else {"prior": Prior(3.0, 0.06, "test")}
    parameters[1] = replace(parameters[1], reference=3.0, **narrow)  # type: ignore[arg-type]
    y = x @ TRUTH + 0.2 * np.random.default_rng(5).standard_normal(N)
    found = fitted(likelihood([y], [x], [STATED], Space(parameters)))
    found = replace(found, point=TRUTH)
    low, high = (2.86, 3.14) if source == "bounds" else (3.0 - 1.9 * 0.06, 3.0 + 1.9 * 0.06)
    ends = np.array([1.99, low, 4.9]), np.array([2.01, high, 5.1])
    verdicts = [one.verdict for one in verdicts_of(found, 3, ends, np.eye(3), "")]
    assert verdicts == [ParameterVerdict.DETERMINED, ParameterVerdict.INSENSITIVE, ParameterVerdict.DETERMINED]


def test_parameters_that_imitate_each_other_are_named() -> None:
    x = design()
    x[:, 1] = x[:, 0] + 0.01 * x[:, 1]
    y = x @ TRUTH + 0.2 * np.random.default_rng(2).standard_normal(N)
    first, second, third = judged(fitted(likelihood([y], [x], [STATED])))
    assert (first.verdict, second.verdict, third.verdict) == (
        ParameterVerdict.COMBINED,
        ParameterVerdict.COMBINED,
        ParameterVerdict.DETERMINED,
    )
    assert "with b" in first.sentence
    assert "with a" in second.sentence


def test_a_quantity_of_the_bench_that_decides_is_blamed() -> None:
    """The second parameter is one of the bench with a prior, and the data hardly tell it from the first."""
    x = design()[:, :2]
    x[:, 1] = x[:, 0] + 0.003 * x[:, 1]
    room = space(2)
    prior = Prior(3.0, 1.0, "stated")
    room = Space([room.parameters[0], replace(room.parameters[1], prior=prior)])
    y = x @ TRUTH[:2] + 0.2 * np.random.default_rng(3).standard_normal(N)
    found = fitted(likelihood([y], [x], [STATED], room=room))
    variances = np.diag(found.covariance.noise)
    correlation = found.covariance.noise / np.sqrt(np.outer(variances, variances))
    ends = tuple(end[:1] for end in interval(found))
    (first,) = verdicts_of(found, 1, (ends[0], ends[1]), correlation, "")
    assert first.verdict is ParameterVerdict.COMBINED
    assert "with b" in first.sentence


def test_bounds_and_constraints_are_said() -> None:
    y = design() @ [2.0, 2.3, 5.0] + 0.2 * np.random.default_rng(5).standard_normal(N)
    first = judged(fitted(likelihood([y], [design()], [STATED], room=space(constraints=["b < a"]))))[0]
    assert first.verdict is ParameterVerdict.CONSTRAINED
    assert '"b < a"' in first.sentence
    y = design() @ [2.0, 3.0, 11.0] + 0.2 * np.random.default_rng(5).standard_normal(N)
    assert judged(fitted(likelihood([y], [design()], [STATED])))[2].verdict is ParameterVerdict.AT_BOUND


def bump(t: Floats) -> Floats:
    return np.asarray(10.0 * np.exp(-(((t - 0.5) / 0.05) ** 2)))


def of_bump(y: Floats, noise: Noise) -> Likelihood:
    """Likelihood of a bump whose height alone is free: a delay is seen."""
    t = np.linspace(0.0, 1.0, N)
    places = np.column_stack([t, np.zeros(N)])
    block = Block("curve", slice(0, N), noise, "1", True, -y, np.ones(N), places)
    return Likelihood(space(1), [block], lambda points: np.asarray(points * bump(t) / 10.0 - y))


@pytest.mark.parametrize("correlation", [Correlation.WHITE, Correlation.AUTO])
def test_a_delay_is_found_and_withdraws_the_verdict(correlation: Correlation) -> None:
    t, rng = np.linspace(0.0, 1.0, N), np.random.default_rng(6)
    noise = replace(STATED, correlation=correlation)
    late = 0.5 * bump(t - 0.004) + 0.2 * rng.standard_normal(N)
    found = fitted(of_bump(late, noise))
    (test,) = lack_of_fit(found, 1)
    assert test.detected
    assert test.suspect == "delay"
    assert withdrawal(found, [test]) == test.sentence
    assert judged(found, 0.9)[0].verdict is ParameterVerdict.NOT_CONFIRMED


def test_the_score_test_is_seldom_alarmed_by_noise() -> None:
    """One false alarm in a hundred is meant; more than 6 of 150 have a probability of 0.3 %."""
    t = np.linspace(0.0, 1.0, N)
    alarms = 0
    for seed in range(150):
        rng = np.random.default_rng(100 + seed)
        (test,) = lack_of_fit(fitted(of_bump(0.5 * bump(t) + 0.2 * rng.standard_normal(N), STATED)), 1)
        alarms += test.detected
    assert alarms <= 6


def test_residuals_beyond_a_stated_sigma_are_found() -> None:
    noise = Noise(law=Law.GAUSSIAN, correlation=Correlation.WHITE, sigma=0.1)
    test = lack_of_fit(fitted(likelihood([curve(7)], [design()], [noise])), 3)[0]
    assert test.detected
    assert "times as" in test.sentence


def test_zeros_of_a_quiet_meter_raise_no_alarm() -> None:
    """Three of four values exactly zero in data and model; as samples they made four times as much of any chance."""
    x, alarms = np.vstack([design(), np.zeros((900, 3))]), 0
    for seed in range(15):
        tests = lack_of_fit(fitted(likelihood([np.append(curve(300 + seed), np.zeros(900))], [x], [STATED])), 3)
        alarms += any(test.detected for test in tests)
    assert alarms <= 1  # at a level of 1 %; half of them with zeros for samples


@pytest.mark.parametrize(("stated", "found"), [(1.0, 0), (0.6, 4)])
def test_the_size_of_residuals_with_tails_is_judged_by_their_law(stated: float, found: int) -> None:
    """Student's t with four degrees of freedom; by a sum of squares each of its outliers was a finding."""
    n, alarms = 300, 0
    for seed in range(4):
        y = design(n) @ TRUTH + 0.2 * np.random.default_rng(40 + seed).standard_t(4.0, n)
        sigma = stated * 0.2 * np.sqrt(2.0)
        noise = Noise(law=Law.STUDENT, correlation=Correlation.WHITE, sigma=sigma)
        size = lack_of_fit(fitted(likelihood([y], [design(n)], [noise])), 3)[0].size
        assert size is not None
        alarms += size < 0.01
    assert alarms == found


def test_a_search_that_has_not_settled_withdraws() -> None:
    found = fitted(likelihood([curve(8)], [design()], [STATED]), starts=4)
    moving = replace(found, agreeing=1)
    assert withdrawal(found, []) == ""
    assert "1 of 4 starts" in withdrawal(moving, [])
    assert judged(moving)[0].verdict is ParameterVerdict.NOT_CONFIRMED


def test_an_interval_that_is_no_figure_is_given_in_words() -> None:
    x = design()
    x[:, 1] *= 1e-9  # a direction that the data hardly hold
    assert "more than ± 1000 %" in judged(fitted(likelihood([curve(9)], [x], [STATED])))[1].sentence


@pytest.mark.parametrize(("wrong", "alarm"), [(0.0, False), (1.0, True)])
def test_a_fixed_value_that_is_wrong_is_named(wrong: float, alarm: bool) -> None:
    """A cause that no parameter imitates, among others that act alike on nothing."""
    t = np.linspace(0.0, 1.0, N)
    causes = {f"cause {i}": np.sin((7.0 + 4.0 * i) * t) for i in range(6)}
    found = fitted(likelihood([curve(21, wrong * causes["cause 3"])], [design()], [STATED]))
    test = lack_of_fit(found, 3, causes)[-1]
    assert (test.name, test.detected) == (FIXED, alarm)
    assert not alarm or test.suspect == "cause 3"
