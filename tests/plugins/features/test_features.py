"""Features of analytic traces: each within a tenth of a sample of its value by the definition, with noise too."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from commonrail.base.errors import ConfigurationError, PluginError
from commonrail.engine.operating_point import Energising, OperatingPoint, Trace
from commonrail.plugins.features.injections import FeatureStatus
from commonrail.plugins.features.rate_trace import RateTrace
from commonrail.plugins.features.result import Features
from commonrail.plugins.features.run import find_features
from commonrail.plugins.features.settings import FeatureSettings
from commonrail.plugins.features.table import FEATURES, features_of_traces, known_features
from tests.distribution import distribution
from tests.plugins.features.analytic import PEAK, SAMPLE, noisy, straight, trapezoid

TENTH = 0.1 * SAMPLE

# Of the trapezoid at 10 %: 15 us up a ramp of 150 us, 10 us before the end of one of 100 us; ramps from 20 to 80 %.
TIMES = {
    "opening": 315e-6,
    "closing": 990e-6,
    "opening_delay": 315e-6,
    "closing_delay": 290e-6,
    "duration": 675e-6,
    "rise_time": 90e-6,
    "fall_time": 60e-6,
}
RATES = {"steady_rate": PEAK, "peak_rate": PEAK}
# Ramps of 150 and 100 us and 450 us between them; after closing a triangle of 10 us and a tenth of the peak.
QUANTITIES = {
    "quantity": PEAK * (75e-6 + 450e-6 + 50e-6),
    "total_quantity": 575e-6 * PEAK,
    "dribble": 0.5 * 10e-6 * 0.1 * PEAK,
}

NOISE = 0.001  # standard deviation of a sample over the peak


def worst(found: Features) -> dict[str, float]:
    """Distances from the truth: of times in samples, of quantities in samples at the peak, of rates over the peak."""
    return (
        {name: abs(found.value(name) - value) / SAMPLE for name, value in TIMES.items()}
        | {name: abs(found.value(name) - value) / (PEAK * SAMPLE) for name, value in QUANTITIES.items()}
        | {name: abs(found.value(name) - value) / PEAK for name, value in RATES.items()}
    )


def test_features_of_a_trapezoid_are_within_a_tenth_of_a_sample() -> None:
    found = find_features(trapezoid())
    assert found.status is FeatureStatus.OK
    assert len(found.injections) == 1
    assert found.injections[0].statuses == ()
    assert set(worst(found)) == set(features_of_traces()) - {"separation"}
    errors = worst(found)
    assert errors.pop("dribble") < 0.01  # closing divides a sample, within which the rate is taken as constant
    # straight pieces and sums of whole samples: rounding alone
    assert {name: error for name, error in errors.items() if error > 1e-9} == {}


@pytest.mark.parametrize("seed", range(20))
def test_with_noise_they_still_are(seed: int) -> None:
    """0.1 % noise, averaged over 5 samples, on a ramp of 3.3 % a sample: 0.02 samples of standard error at most."""
    found = find_features(noisy(trapezoid(), NOISE, seed))
    errors = worst(found)
    assert len(found.injections) == 1
    assert {n: e for n, e in errors.items() if n not in RATES and e > 0.1} == {}
    assert errors["steady_rate"] < NOISE  # mean of 50 samples
    assert errors["peak_rate"] < NOISE  # the largest of some 10 independent means of 10


def test_standard_errors_are_the_scatter_of_shots_and_there_is_no_bias() -> None:
    """1 % noise, 300 shots: scatter is known to 4 %, and of the mean to a twentieth of a sample."""
    shots = [find_features(noisy(trapezoid(), 0.01, seed)) for seed in range(300)]
    for name in ("opening", "closing", "opening_delay", "closing_delay", "duration", "quantity"):
        values = np.array([shot.value(name) for shot in shots])
        stated = np.array([shot.injections[0].standard_errors[name] for shot in shots])
        assert np.std(values) == pytest.approx(np.median(stated), rel=0.25), name
        if name in TIMES:
            assert abs(values.mean() - TIMES[name]) < TENTH, name


def test_the_same_injection_in_other_samples_has_the_same_features() -> None:
    """Means over 1, 5 and 10 us, and uneven ones, of one course."""
    settings = FeatureSettings(averaging="10 us")
    fine = trapezoid(sample=1e-6)
    rows = np.sort(np.random.default_rng(3).choice(np.arange(1, 2199), 1100, replace=False))
    bounds = np.concatenate(([fine.bounds[0]], fine.bounds[rows], [fine.bounds[-1]]))
    uneven = RateTrace(bounds, np.diff(np.interp(bounds, fine.bounds, fine.cumulated)) / np.diff(bounds))
    for trace in (fine, trapezoid(), trapezoid(sample=10e-6), uneven):
        found = find_features(trace, OperatingPoint(160e6, 700e-6), settings)
        for name, value in TIMES.items():
            assert found.value(name) == pytest.approx(value, abs=TENTH), name
        assert found.value("quantity") == pytest.approx(QUANTITIES["quantity"], rel=1e-9)


def test_a_threshold_is_a_share_or_a_rate() -> None:
    half = find_features(trapezoid(), settings=FeatureSettings(threshold="50 %"))
    assert half.value("opening") == pytest.approx(375e-6, abs=1e-12)
    absolute = find_features(trapezoid(), settings=FeatureSettings(threshold="25 mm3/ms"))
    assert absolute.value("opening") == pytest.approx(375e-6, abs=1e-12)
    with pytest.raises(ConfigurationError, match=r"kg/s.* m3/s"):
        find_features(trapezoid(), settings=FeatureSettings(threshold="2 mg/ms"))


@pytest.mark.parametrize(("threshold", "read"), [("2", '"2"'), (2.0, "2"), ("-1 mm3/ms", '"-1 mm3/ms"')])
def test_a_threshold_without_its_unit_is_refused_as_it_was_written(threshold: object, read: str) -> None:
    with pytest.raises(ConfigurationError, match=f" {read}[.]$"):
        FeatureSettings(threshold=threshold)


def test_levels_of_one_trace_apply_to_another() -> None:
    weak = RateTrace(trapezoid().bounds, 0.5 * trapezoid().rate)
    levels = find_features(trapezoid()).levels
    assert find_features(weak, levels=levels).value("opening") == pytest.approx(330e-6, abs=1e-12)
    assert find_features(weak).value("opening") == pytest.approx(315e-6, abs=1e-12)


def test_a_short_injection_has_no_steady_rate() -> None:
    triangle = straight((300e-6, 450e-6, 550e-6), (0.0, PEAK, 0.0), energisings=[(0.0, 200e-6)])
    found = find_features(triangle)
    assert math.isnan(found.value("steady_rate"))
    assert found.injections[0].statuses == (FeatureStatus.NO_PLATEAU,)
    assert found.value("quantity") == pytest.approx(125e-6 * PEAK, rel=1e-9)


def test_a_trace_of_nothing_gives_a_status_and_no_number() -> None:
    nothing = RateTrace(trapezoid().bounds, np.zeros_like(trapezoid().rate), energisings=(Energising(0.0, 700e-6),))
    for trace in (nothing, noisy(nothing, 0.002, 1), noisy(nothing, 0.5, 2)):
        found = find_features(trace)
        assert (found.status, found.injections, found.silent) == (FeatureStatus.NO_INJECTION, (), (1,))
        assert all(math.isnan(found.value(name)) for name in features_of_traces())
        assert found.status.sentence.endswith(".")


def test_a_stated_threshold_above_the_trace_finds_nothing() -> None:
    found = find_features(trapezoid(), settings=FeatureSettings(threshold="60 mm3/ms"))
    assert (found.status, found.injections) == (FeatureStatus.NO_INJECTION, ())
    assert found.reason(1) is FeatureStatus.NO_INJECTION


def test_an_injection_that_the_trace_cuts_says_so() -> None:
    late = find_features(trapezoid(begin=600e-6))
    assert FeatureStatus.CUT_AT_START in late.injections[0].statuses
    assert math.isnan(late.value("opening"))
    assert math.isnan(late.value("duration"))
    assert late.value("closing") == pytest.approx(990e-6, abs=1e-12)
    early = find_features(trapezoid(end=700e-6))
    assert FeatureStatus.CUT_AT_END in early.injections[0].statuses
    assert math.isnan(early.value("dribble"))
    assert early.value("opening") == pytest.approx(315e-6, abs=1e-12)


def test_an_offset_at_rest_is_subtracted_if_asked() -> None:
    trace = trapezoid()
    raised = RateTrace(trace.bounds, trace.rate + 0.05 * PEAK, energisings=trace.energisings)
    found = find_features(raised, settings=FeatureSettings(zero_at_rest=True))
    assert found.value("quantity") == pytest.approx(QUANTITIES["quantity"], rel=1e-9)
    assert find_features(raised).value("quantity") > 1.05 * QUANTITIES["quantity"]
    with pytest.raises(ConfigurationError, match="zero_at_rest"):
        find_features(RateTrace(trace.bounds, trace.rate), settings=FeatureSettings(zero_at_rest=True))


def test_the_error_of_the_zero_is_in_that_of_the_quantity() -> None:
    """The mean of 39 samples at rest is subtracted over 340; 300 shots give the scatter to 4 %."""
    settings = FeatureSettings(zero_at_rest=True)
    shots = [find_features(noisy(trapezoid(), 0.01, seed), settings=settings) for seed in range(300)]
    scatter = float(np.std([shot.value("quantity") for shot in shots], ddof=1))
    stated = float(np.mean([shot.injections[0].standard_errors["quantity"] for shot in shots]))
    # noise is the larger of two estimates, on average 8 % too large here; three errors of the scatter are 12 %
    assert scatter == pytest.approx(stated, rel=0.2)
    alone = float(
        np.mean([find_features(noisy(trapezoid(), 0.01, s)).injections[0].standard_errors["quantity"] for s in (1, 2)])
    )
    assert stated > 2.0 * alone


def test_samples_of_a_trace_are_means_around_their_times() -> None:
    trace = trapezoid()
    middles = 0.5 * (trace.bounds[1:] + trace.bounds[:-1])
    found = find_features(Trace.of(middles, trace.rate), trace.energisings)
    assert {name: found.value(name) for name in TIMES} == pytest.approx(TIMES, abs=1e-12)


def test_a_rate_by_mass_has_its_own_units() -> None:
    trace = RateTrace(trapezoid().bounds, 820.0 * trapezoid().rate, "kg/s")
    found = find_features(trace, settings=FeatureSettings(threshold="4.1 mg/ms"))
    assert found.value("opening") == pytest.approx(315e-6, abs=1e-12)
    assert found.value("quantity") == pytest.approx(820.0 * QUANTITIES["quantity"], rel=1e-9)


def test_a_record_is_plain_data() -> None:
    record = find_features(trapezoid()).record()
    assert record["injections"][0]["values"]["separation"] is None
    assert record["injections"][0]["values"]["opening"] == pytest.approx(315e-6)


@pytest.mark.parametrize(
    ("source", "word"),
    [(3.0, "RateTrace"), ("trace.csv", "commonrail.simulate")],
)
def test_what_has_no_rate_is_refused(source: object, word: str) -> None:
    with pytest.raises(ConfigurationError, match=word):
        find_features(source)
    with pytest.raises(ConfigurationError, match='"opning"'):
        find_features(trapezoid()).value("opning")


def test_a_feature_of_a_package_that_fails_is_named_with_it(tmp_path: Path) -> None:
    text = (
        "from commonrail.plugins.features.table import Feature\n"
        "BAD = Feature('bad', 's', 'divided by zero', lambda one: 1 / 0)\n"
        "OTHER = Feature('another', 's', 'of another name')\n"
    )
    parts = "[commonrail.features]\nbad = example_features:BAD\nsecond = example_features:OTHER\nquantity = x:Y\n"
    said = r'example-plugin 1\.2: "bad" of commonrail\.features fails \(ZeroDivisionError'
    with distribution(tmp_path, {"example_features": text}, parts):
        with pytest.warns(RuntimeWarning) as warned:
            names = set(known_features())
        with pytest.raises(PluginError, match=said):
            find_features(trapezoid())
    assert names - set(FEATURES) == {"bad"}
    sentences = " ".join(str(one.message) for one in warned)
    assert re.search('"second" of commonrail.features .*"another"', sentences)
    assert '"quantity" of commonrail.features' in sentences
