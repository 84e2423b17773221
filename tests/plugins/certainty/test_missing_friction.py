"""Test of friction that a model lacks, on virtual benches that have some or none."""

from __future__ import annotations

from dataclasses import replace

import pytest

from commonrail.calibration.identifiability import ParameterVerdict
from commonrail.calibration.study import Study
from commonrail.data.noise import Noise
from commonrail.plugins.certainty.estimate import Estimate
from commonrail.plugins.certainty.lack_of_fit import LEVEL, lack_of_fit, of_missing
from commonrail.plugins.certainty.likelihood import Likelihood
from commonrail.plugins.certainty.missing import missing_friction
from commonrail.plugins.certainty.run import friction_withdraws
from commonrail.plugins.certainty.verdict import verdicts_of, withdrawal
from tools.coverage import BEDS, FRICTION, Benches


def test_friction_that_moves_a_pinned_parameter_withdraws_it() -> None:
    benches = Benches(BEDS["friction that nobody has stated"])
    bench = benches.bench(5)
    found = benches.fit(bench)
    tests = lack_of_fit(found)
    low, high = found.interval()
    verdicts = verdicts_of(found, low, high, withdrawal(found, tests))
    assert any(one.verdict is ParameterVerdict.PINNED for one in verdicts)  # the tests of the meter see nothing
    k7 = bench.truth[2]
    assert not low[2] < k7 < high[2]  # 16 % off
    friction = friction_withdraws(bench.study, found, verdicts, 1)
    assert friction is not None
    test = of_missing(friction, LEVEL / 3.0)
    assert test.found  # its probability is 1e-11
    assert "friction in the guides" in withdrawal(found, [*tests, test])
    assert abs(friction.point[2] - k7) < 0.6 * abs(found.point[2] - k7)
    unseen = [one._replace(verdict=ParameterVerdict.UNSEEN) for one in verdicts]  # which have nothing to lose
    assert friction_withdraws(bench.study, found, unseen, 1) is None


@pytest.mark.parametrize("bed", ["white", "autoregressive"])
def test_a_bench_without_friction_raises_no_alarm(bed: str) -> None:
    benches = Benches(BEDS[bed])
    bench = benches.bench(1)
    friction = missing_friction(bench.study, benches.fit(bench), 1)
    assert friction is not None
    assert friction.probability > LEVEL
    assert friction.simulated < 300


def test_friction_of_the_model_or_of_a_statement_is_not_missing() -> None:
    benches = Benches(BEDS["friction that nobody has stated"])
    bench = benches.bench(2)
    found = benches.fit(bench)
    with_some = bench.study.injector.with_values({"plunger_needle.viscous": 1.0})
    assert missing_friction(replace(bench.study, injector=with_some), found, 1) is None
    (curve,) = bench.study.data
    stated = replace(bench.study, data=(curve.changed(noise=Noise(uncertain=FRICTION)),))
    assert missing_friction(stated, estimate_at_truth(stated, found), 1) is None


def estimate_at_truth(study: Study, found: Estimate) -> Estimate:
    """Estimate whose likelihood is that of a study."""
    own = Likelihood.of(study, 1).with_noises(found.likelihood.noises)
    return replace(found, likelihood=own)
