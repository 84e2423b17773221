"""Tests for lack of fit where a delay is stated as uncertain: it is no finding up to its standard deviation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import commonrail as cr
from commonrail.data.noise import Correlation, Law, Noise
from commonrail.plugins.certainty.lack_of_fit import assess_residuals, lack_of_fit
from commonrail.plugins.certainty.nuisance import SIDES
from tests.plugins.certainty.linear import TRUTH, Uncertain, design, fitted, likelihood, linear
from tools.coverage import BEDS, Benches

WHITE = Noise(law=Law.GAUSSIAN, correlation=Correlation.WHITE, sigma=0.2)


def test_a_delay_of_its_stated_size_is_no_finding() -> None:
    benches = Benches(BEDS["delay 2 us"])
    bench = benches.bench(26)  # -1.9 us
    found = benches.fit(bench)
    assert lack_of_fit(found)[0].score < 5e-3  # the derivatives at the fitted values do not know where it leads to
    (test, delay), simulated = assess_residuals(bench.study, found, None, 1)
    assert not delay.found
    assert not test.found
    assert test.score > 0.05
    assert 100 < simulated < 1000


def test_another_fault_is_found_beside_it() -> None:
    stated = Noise(correlation=Correlation.WHITE, uncertain={"delay": 2e-6})  # else an autoregression takes the offset
    benches = Benches(replace(BEDS["delay 2 us"], stated=stated))
    bench = benches.bench(26)
    (curve,) = bench.study.data
    assert isinstance(curve, cr.RateData)
    shifted = replace(bench.study, data=(replace(curve, rate=curve.rate + 0.2e-6),))  # an offset of 0.7 deviations
    found = benches.fit(bench._replace(study=shifted))
    (test, delay), simulated = assess_residuals(shifted, found, None, 1)
    assert delay.suspect == delay.name == "meter.unnamed_1.delay"
    assert (test.found, test.suspect) == (True, "offset")
    assert simulated > 100


def test_without_anything_uncertain_nothing_is_fitted_again() -> None:
    benches = Benches(BEDS["white"])
    bench = benches.bench(1)
    tests, simulated = assess_residuals(bench.study, benches.fit(bench), None, 1)
    assert (len(tests), simulated) == (1, 0)


@pytest.mark.parametrize(("deviations", "is_found"), [(1.0, False), (8.0, True)])
def test_what_is_stated_explains_no_more_than_its_size(deviations: float, is_found: bool) -> None:
    """An offset of the meter, stated with a standard deviation that is 0.1: one of 0.8 is another fault."""
    x = design()
    offset = 0.1 * np.ones(len(x))
    y = x @ TRUTH + deviations * offset + 0.2 * np.random.default_rng(4).standard_normal(len(x))
    nuisance = linear("offset", offset)
    (test,) = lack_of_fit(fitted(likelihood([y], [x], [WHITE], [nuisance])))
    assert (test.score < 1e-3) is is_found


def test_the_second_change_of_what_is_stated_is_no_finding_either() -> None:
    x, t = design(), np.linspace(0.0, 1.0, 300)
    bend = 0.5 * np.gradient(np.gradient(x @ TRUTH, t), t) / 50.0
    y = x @ TRUTH + 0.2 * bend + 0.02 * np.random.default_rng(4).standard_normal(len(x))
    noise = replace(WHITE, sigma=0.02)
    nothing = np.zeros(len(x))
    for change, is_found in ((nothing, True), (0.2 * bend, False)):
        nuisance = Uncertain("delay", lambda z, _, c=change: z**2 * c, SIDES)
        (test,) = lack_of_fit(fitted(likelihood([y], [x], [noise], [nuisance])))
        assert (test.score < 1e-3) is is_found
