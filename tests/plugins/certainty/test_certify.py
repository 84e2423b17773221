"""Certainty of a real study: the likelihood of its data, uncertain quantities, repeated shots, the whole record."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import commonrail as cr
from commonrail.base.errors import ConfigurationError
from commonrail.data.noise import Correlation, Noise
from commonrail.data.simulator import Simulator
from commonrail.physics.meters import Meter
from commonrail.plugins.certainty.estimate import estimate
from commonrail.plugins.certainty.verdict import assumed_shifts
from commonrail.plugins.new.study import write_new

# Declared truth of the example's curve; its noise is white with 0.3 mm³/ms.
TRUTH = {
    "control_chamber.z_hole_diameter": 0.211e-3,
    "control_chamber.a_hole_diameter": 0.268e-3,
    "nozzle.discharge_maximum": 0.80,
}


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> cr.Study:
    """The example of `commonrail new`."""
    folder = tmp_path_factory.mktemp("own")
    write_new(folder / "own")
    return cr.load_study(folder / "own" / "study.toml")


@pytest.fixture(scope="module")
def found(study: cr.Study) -> cr.Certainty:
    """Certainty near its truth, one parameter profiled."""
    names = ["nozzle.discharge_maximum"]
    return cr.certify(study, TRUTH, threads=1, profiles=names, combinations=["nozzle.discharge_maximum"])


def with_noise(study: cr.Study, noise: Noise) -> cr.Study:
    return replace(study, data=tuple(one.changed(noise=noise) for one in study.data))


def test_the_example_is_known_to_the_size_of_its_noise(found: cr.Certainty) -> None:
    sigma = found.estimate.likelihood.noises[0].sigma
    assert sigma == pytest.approx(0.3, rel=0.2)
    # the truth was made by the reference engine; the error of the fast one is below 0.2 % in each of these
    np.testing.assert_allclose(found.estimate.point, list(TRUTH.values()), rtol=2e-3)


def test_a_profile_agrees_with_the_curvature_where_the_model_is_nearly_linear(found: cr.Certainty) -> None:
    low, high = found.estimate.interval()
    # no quantity of the study is uncertain: what is added to the profile is the time step's error alone
    assert found.estimators[2] == "profile likelihood, error of the time step added"
    assert found.estimators[0].startswith("curvature")
    np.testing.assert_allclose(found.high[2] - found.low[2], high[2] - low[2], rtol=0.1)


def test_a_single_parameter_is_a_combination_too(found: cr.Certainty) -> None:
    value, half = found.combinations["nozzle.discharge_maximum"]
    low, high = found.estimate.interval()
    assert value == pytest.approx(found.estimate.point[2])
    assert half == pytest.approx(0.5 * (high[2] - low[2]), rel=1e-6)


def test_the_gain_is_the_difference_of_two_likelihoods(study: cr.Study, found: cr.Certainty) -> None:
    own = found.estimate.likelihood
    points = np.array([found.estimate.point, list(TRUTH.values())])
    here, there = own.log_likelihood(points) + own.log_prior(points)
    assert found.gain == pytest.approx(2.0 * (here - there), rel=1e-6)
    assert 0.0 < found.gain < 16.3  # chi-squared of 3 at 99.9 %: the search began at the truth


def test_the_record_is_json_and_names_every_estimator(found: cr.Certainty) -> None:
    record = json.loads(json.dumps(found.record(), allow_nan=False))
    assert all(one["estimator"] and one["sentence"] for one in record["parameters"])
    assert [one["quantity"] for one in record["sensitivity"]] == ["delay", "gain"]


def test_a_simulated_delay_moves_what_the_shifted_course_says(study: cr.Study, found: cr.Certainty) -> None:
    """Derivative of the meter by two simulations, against the slope of the course by none."""
    own = cr.Likelihood.of(with_noise(study, Noise(uncertain={"delay": 1e-6, "gain": 0.01})), 1)
    both = estimate(own, found.estimate.unit[None], rounds=1)
    scale = own.scaled(both.unit)
    for nuisance, (assumed, move) in zip(both.covariance.nuisances, assumed_shifts(both), strict=True):
        # the course is sampled every 5 us, where its flanks bend
        shares, expected = nuisance * scale / both.point, move[0] / both.point
        np.testing.assert_allclose(shares, expected, atol=0.15 * np.abs(expected).max())
        assert assumed.change > 0.0


def test_the_likelihood_counts_failures_and_keeps_to_the_bounds(study: cr.Study, found: cr.Certainty) -> None:
    own = found.estimate.likelihood
    points = np.array([found.estimate.point, 1.5 * found.estimate.point])
    assert np.isfinite(own.log_likelihood(points[:1])).all()
    assert own.log_prior(points)[1] == -np.inf
    assert own.names == study.space.names


@pytest.mark.parametrize("quiet", [0, 200])
def test_repeated_shots_give_the_noise(study: cr.Study, quiet: int) -> None:
    """Also of a meter that shows exactly zero in the first samples of every shot."""
    (curve,) = study.data
    rng = np.random.default_rng(1)
    shots = []
    for i in range(4):
        noisy = curve.measured + 5e-7 * rng.standard_normal(len(curve.measured))
        noisy[:quiet] = 0.0
        shots.append(replace(curve, name=f"shot {i}", rate=noisy, noise=Noise(shots="all")))  # type: ignore[call-arg]
    noise = cr.Likelihood.of(replace(study, data=tuple(shots)), 1).blocks[0].shots
    assert noise is not None
    assert noise.sigma == pytest.approx(0.5, rel=0.06)  # two standard errors of 900 differences
    assert noise.freedom == pytest.approx(3 * (len(curve.measured) - quiet))


def test_what_a_filter_leaves_of_zero_is_no_noise(study: cr.Study) -> None:
    """A zero-phase filter rounds: where nothing was measured, as many samples as not would look like outliers' rest."""
    (curve,) = study.data
    noisy = curve.measured + 5e-7 * np.random.default_rng(1).standard_normal(len(curve.measured))
    meter = Meter("tube", {"cutoff": "20 kHz"}, "zero-phase")
    simulator = Simulator(study.injector, study.space.names, study.time_step, 1)
    point = np.array([list(TRUTH.values())])
    shown = curve.changed(meter=meter).simulated(simulator, point)[0]  # type: ignore[attr-defined]
    quiet = int(np.argmax(np.abs(shown) > 1e-9 * shown.max()))
    assert quiet > 5
    assert (shown[:quiet] != 0.0).any()
    noisy[:quiet] = 0.0
    metered = replace(curve, rate=noisy).changed(meter=meter)  # type: ignore[call-arg]
    errors = cr.Likelihood.of(replace(study, data=(metered,)), 1).residuals(point)[0]
    assert np.count_nonzero(errors) == len(errors) - quiet
    assert (errors[:quiet] == 0.0).all()


@pytest.mark.parametrize(
    ("noise", "words"),
    [
        (Noise(shots="alone"), "repeated shots"),
        (Noise(uncertain={"cutoff": 1e3}), "cutoff"),
        (Noise(uncertain={"nozzle.discharge_maximum": 0.01}), "free in the fit"),
        (Noise(uncertain={"quantity_offset": 1e-10}), "no effect"),
    ],
)
def test_noise_that_does_not_fit_the_study_is_refused(study: cr.Study, noise: Noise, words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        cr.Likelihood.of(with_noise(study, noise), 1)


def test_a_stated_correlation_is_kept(study: cr.Study) -> None:
    own = cr.Likelihood.of(with_noise(study, Noise(correlation=Correlation.WHITE)), 1)
    point = np.array(list(TRUTH.values()))
    errors = own.residuals(point[None])[0]
    assert own.estimated(errors, [3.0]).noises[0].autoregression.order == 0


def test_unknown_names_are_refused(study: cr.Study) -> None:
    with pytest.raises(ConfigurationError, match="is no free parameter"):
        cr.certify(study, TRUTH, profiles=["nozzle.holes"])


def test_the_verb_writes_result_and_report(study: cr.Study, tmp_path: Path) -> None:
    from tests.cli.conftest import run_command

    folder = tmp_path / "own"
    write_new(folder)
    text = (folder / "study.toml").read_text(encoding="utf-8").replace("generations = 30", "generations = 2")
    (folder / "study.toml").write_text(text.replace("polish = 3", "polish = 0"), encoding="utf-8")
    run = tmp_path / "run"
    assert run_command("calibrate", folder / "study.toml", "--out", run, "--threads", 1).status == 0
    done = run_command("certainty", run, "--local", "--starts", 2, "--threads", 1, "--json")
    assert done.status == 0, done.err
    kept = json.loads((run / "result.json").read_text(encoding="utf-8"))
    assert kept["certainty"] == done.record["certainty"]
    assert kept["certainty"]["starts"] == 2
    assert "Certainty" in (run / "report.html").read_text(encoding="utf-8")
    wrong = run_command("certainty", tmp_path / "nothing")
    assert wrong.status == 2
    assert "there is no such folder" in wrong.sentence


def test_an_end_far_from_the_fitted_values_is_to_be_confirmed_by_other_starts(study: cr.Study) -> None:
    """One search that leaves the fitted values may end in another optimum; several that agree have not."""
    away = {name: 1.01 * value for name, value in TRUTH.items()}
    alone, among = (cr.certify(study, away, threads=1, starts=starts) for starts in (1, 4))
    assert "no search from other starts has confirmed it" in alone.withdrawn
    assert {judged.verdict.value for judged in alone.verdicts} == {"withdrawn"}
    assert among.withdrawn == ""
    assert "pinned" in {judged.verdict.value for judged in among.verdicts}


def test_a_notebook_shows_its_verdicts_and_intervals(found: cr.Certainty) -> None:
    line = repr(found)
    assert f"{len(found.verdicts)} parameter" in line
    for verdict, count in Counter(judged.verdict.value for judged in found.verdicts).items():
        assert f"{count} {verdict}" in line
    assert len(line) < 300
    html = found._repr_html_()
    assert all(name in html for name in found.estimate.likelihood.names)
    pytest.importorskip("pandas", reason="pandas comes with the extra notebook")
    frame = found.to_pandas()
    assert frame["lower"].tolist() == pytest.approx(found.low.tolist(), nan_ok=True)
    assert frame["unit"].tolist() == list(found.estimate.likelihood.units)
