"""Test of a delay that a study lacks, on virtual benches that have one or none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import commonrail as cr
from commonrail.data.noise import Noise
from commonrail.plugins.certainty import missing
from commonrail.plugins.certainty.estimate import Estimate, estimate
from commonrail.plugins.certainty.lack_of_fit import LEVEL, lack_of_fit, level_of
from commonrail.plugins.certainty.likelihood import Likelihood
from commonrail.plugins.certainty.missing import CURVES, missing_delay, visible_delay
from commonrail.plugins.certainty.verdict import withdrawal
from tools.coverage import BEDS, Bench, Benches, autoregressive, white


def fitted(name: str, **changes: object) -> tuple[Bench, Estimate]:
    benches = Benches(replace(BEDS[name], **changes))  # type: ignore[arg-type]
    bench = benches.bench(1)
    return bench, benches.fit(bench)


@pytest.fixture(scope="module")
def undelayed() -> tuple[Bench, Estimate]:
    return fitted("white")


@pytest.mark.parametrize("noise", [white, autoregressive])
def test_a_delay_of_five_microseconds_is_found_whatever_the_noise(noise: object) -> None:
    bench, found = fitted("unstated delay 5 us, known white", noise=noise, stated=Noise())
    delay = missing_delay(bench.study, found, 1)
    assert delay is not None
    # 3e-19 and 3e-5 on this bench; the derivative at the fitted values gives 6e-6 and 0.7
    assert delay.probability < 1e-3
    assert 1e-6 < delay.values[0] < 8e-6
    tests = lack_of_fit(found, delay)
    assert tests[-1].name == CURVES
    assert "a delay of the meter of about" in tests[-1].sentence
    assert "a delay of the meter" in withdrawal(replace(found, agreeing=4, gain=0.0), tests)
    # the value that belongs to it is nearer to the truth, 20 % away without
    k7 = bench.truth[2]
    assert abs(delay.point[2] - k7) < 0.7 * abs(found.point[2] - k7)


def test_a_search_caught_in_another_maximum_begins_again_at_the_fit_without_a_delay(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """From −30 µs alone the search ends below the fit that it contains: probability 1 for a delay of 5 µs."""
    bench, found = fitted("unstated delay 5 us, known white")
    monkeypatch.setattr(missing, "BEGINS", np.array([-30e-6]))
    delay = missing_delay(bench.study, found, 1)
    assert delay is not None
    assert delay.probability < 1e-3
    assert 1e-6 < delay.values[0] < 8e-6


def test_a_bench_without_a_delay_raises_no_alarm(undelayed: tuple[Bench, Estimate]) -> None:
    bench, found = undelayed
    delay = missing_delay(bench.study, found, 1)
    assert delay is not None
    assert delay.probability > LEVEL
    assert abs(delay.values[0]) < 1.5e-6  # 0.4 us
    assert not any(test.found for test in lack_of_fit(found, delay))


def test_the_delay_that_is_visible_leaves_what_the_test_asks_for(undelayed: tuple[Bench, Estimate]) -> None:
    bench, found = undelayed
    level = level_of(found, delayed=True)
    assert level == pytest.approx(LEVEL / 3.0)
    small, _ = visible_delay(bench.study, found, level, 1)
    # 1.8 us; make coverage finds 1.95 us in 88 of 100 benches
    assert 1.2e-6 < small < 2.2e-6
    noises = [replace(noise, scale=2.0 * noise.scale) for noise in found.likelihood.noises]
    noisy = replace(found, likelihood=found.likelihood.with_noises(noises))
    # in proportion to the noise, but that the parameters imitate more of a larger delay
    assert np.isclose(visible_delay(bench.study, noisy, level, 1)[0], 2.0 * small, rtol=0.35)


def test_priors_that_contradict_the_data_do_not_make_a_delay_visible(undelayed: tuple[Bench, Estimate]) -> None:
    bench, _ = undelayed
    space = bench.study.space
    # ten of its standard deviations off, and as many times as wide as the standard error by the data
    prior = cr.Prior(0.83, 0.003, "a sister part that is none")
    parameters = [replace(p, prior=prior) if "discharge" in p.name else p for p in space.parameters]
    study = replace(bench.study, space=cr.Space(parameters))
    own = Likelihood.of(study, 1)
    found = estimate(own, own.space.to_unit(bench.truth)[None])
    assert found.likelihood.priors.costs(found.point[None])[0] > 50.0
    small, _ = visible_delay(study, found, LEVEL / 2.0, 1)
    assert 1.2e-6 < small < 2.2e-6  # as without the prior; 0.03 us where its cost counts


@pytest.mark.parametrize(("delay", "is_found"), [(0.3e-6, False), (5e-6, True)])
def test_a_delay_far_beyond_its_stated_deviation_is_found(delay: float, is_found: bool) -> None:
    """Of 5 µs where 0.2 µs are stated the derivatives alone find nothing at 1 %."""
    stated = replace(BEDS["delay 0.2 us"], delay=delay, delay_deviation=0.0)
    benches = Benches(stated)
    bench = benches.bench(1)
    found = benches.fit(bench)
    test = missing_delay(bench.study, found, 1)
    assert test is not None
    assert (test.probability < 1e-3) is is_found
    assert not is_found or "which is beyond what the study states" in lack_of_fit(found, test)[-1].sentence
    assert len(test.point) == 3


def test_a_delay_of_a_few_of_its_stated_deviations_is_no_finding() -> None:
    """4 µs where 2 µs are stated: 3.5 µs are most likely on this bench, 1.7 deviations, which have 0.08."""
    benches = Benches(replace(BEDS["delay 2 us"], delay=4e-6, delay_deviation=0.0))
    bench = benches.bench(3)
    test = missing_delay(bench.study, benches.fit(bench), 1)
    assert test is not None
    assert 0.05 < test.probability < 0.3  # 0.076
    assert 2e-6 < test.values[0] < 5e-6


def test_a_stated_delay_that_the_first_search_does_not_find_is_no_finding() -> None:
    """−1.5 µs where 2 µs are stated: two paths of the parameters, about −2 and −4 µs, explain the curve alike."""
    benches = Benches(BEDS["delay 2 us"])
    bench = benches.bench(31)
    test = missing_delay(bench.study, benches.fit(bench), 1)
    assert test is not None
    assert -5e-6 < test.values[0] < 0.0
    assert test.probability > 0.1  # that of one standard deviation is 0.3


def test_a_free_delay_is_not_missing(undelayed: tuple[Bench, Estimate]) -> None:
    bench, found = undelayed
    parameter = cr.Parameter("meter.bench.delay", 0.0, -5e-6, 5e-6, "s", mark="E", source="test")
    curve = bench.study.data[0].changed(meter=cr.Meter("bench"))
    study = replace(bench.study, data=(curve,), space=cr.Space([*bench.study.space.parameters, parameter]))
    own = Likelihood.of(study, 1)
    free = replace(found, likelihood=own.with_noises(found.likelihood.noises))
    assert missing_delay(study, free, 1) is None
    assert np.isnan(visible_delay(study, free, 0.01, 1)[0])
