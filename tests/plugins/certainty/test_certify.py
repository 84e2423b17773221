"""Certainty of a real study: the likelihood of its data, uncertain quantities, repeated shots, the whole record."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import commonrail as cr
from commonrail.base.errors import ConfigurationError, InputError
from commonrail.data.noise import Correlation, Noise
from commonrail.data.simulator import Simulator
from commonrail.physics.meters import Meter
from commonrail.plugins.certainty.linear import certify_near
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
def found(study: cr.Study) -> cr.fit.Certainty:
    """Certainty near its truth."""
    return cr.certainty(study, TRUTH, threads=1, combinations=["nozzle.discharge_maximum"])


def with_noise(study: cr.Study, noise: Noise) -> cr.Study:
    return replace(study, data=tuple(one.changed(noise=noise) for one in study.data))


def test_the_example_is_known_to_the_size_of_its_noise(found: cr.fit.Certainty) -> None:
    sigma = found.estimate.likelihood.noises[0].sigma
    assert sigma == pytest.approx(0.3, rel=0.2)
    assert ((found.low <= list(TRUTH.values())) & (found.high >= list(TRUTH.values()))).all()
    assert not found.draws.refusal
    # delay and gain, of which the study states nothing, are where a bench without a meter has them
    bench = {one["name"]: one for one in found.record()["bench"]}
    assert abs(bench["meter.unnamed.delay"]["value"]) < 2e-6
    assert bench["meter.unnamed.gain"]["value"] == pytest.approx(1.0, abs=0.02)


def test_a_single_parameter_is_a_combination_too(found: cr.fit.Certainty) -> None:
    value, low, high = found.combinations["nozzle.discharge_maximum"]
    assert value == pytest.approx(found.point[2])
    assert (min(low, value), max(high, value)) == pytest.approx((found.low[2], found.high[2]))


def test_the_record_is_json_and_every_interval_holds_its_value(found: cr.fit.Certainty) -> None:
    record = json.loads(json.dumps(found.record(), allow_nan=False))
    assert all(one["lower"] <= one["value"] <= one["upper"] for one in record["parameters"])
    assert all(one["sentence"] for one in record["parameters"])


def test_certainty_of_given_values_costs_few_simulations_and_widens_by_their_distance(study: cr.Study) -> None:
    near = certify_near(study, TRUTH, 1)
    far = certify_near(study, {name: 1.02 * value for name, value in TRUTH.items()}, 1)
    for name in TRUTH:
        close, away = near[name].standard_error, far[name].standard_error
        assert close is not None
        assert away is not None
        assert away > close


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
    noise = cr.fit.Likelihood.of(replace(study, data=tuple(shots)), 1).blocks[0].shots
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
    errors = cr.fit.Likelihood.of(replace(study, data=(metered,)), 1).residuals(point)[0]
    assert np.count_nonzero(errors) == len(errors) - quiet
    assert (errors[:quiet] == 0.0).all()


def test_repeated_shots_need_two(study: cr.Study) -> None:
    with pytest.raises(ConfigurationError, match="repeated shots"):
        cr.fit.Likelihood.of(with_noise(study, Noise(shots="alone")), 1)


def test_a_stated_correlation_is_kept(study: cr.Study) -> None:
    own = cr.fit.Likelihood.of(with_noise(study, Noise(correlation=Correlation.WHITE)), 1)
    point = np.array(list(TRUTH.values()))
    errors = own.residuals(point[None])[0]
    assert own.estimated(errors, [3.0]).noises[0].autoregression.order == 0


def test_unknown_names_are_refused(study: cr.Study) -> None:
    with pytest.raises(InputError, match="nozzle"):
        cr.certainty(study, TRUTH, combinations=["nozzle.holes"])


def test_the_verb_writes_result_and_report(study: cr.Study, tmp_path: Path) -> None:
    from tests.cli.conftest import run_command

    folder = tmp_path / "own"
    write_new(folder)
    text = (folder / "study.toml").read_text(encoding="utf-8").replace("generations = 30", "generations = 2")
    (folder / "study.toml").write_text(text.replace("polish = 3", "polish = 0"), encoding="utf-8")
    run = tmp_path / "run"
    assert run_command("calibrate", folder / "study.toml", "--out", run, "--threads", 1).status == 0
    done = run_command("certainty", run, "--starts", 4, "--threads", 1, "--json")
    assert done.status == 0, done.err
    kept = json.loads((run / "result.json").read_text(encoding="utf-8"))
    assert kept["certainty"] == done.record["certainty"]
    assert kept["certainty"]["starts"] == 4
    assert "Certainty" in (run / "report.html").read_text(encoding="utf-8")
    wrong = run_command("certainty", tmp_path / "nothing")
    assert wrong.status == 2
    assert "no such" in wrong.sentence


def test_a_notebook_shows_its_verdicts_and_intervals(found: cr.fit.Certainty) -> None:
    line = repr(found)
    assert f"{len(found.verdicts)} parameter" in line
    for verdict, count in Counter(judged.verdict.value for judged in found.verdicts).items():
        assert f"{count} {verdict}" in line
    assert len(line) < 300
    html = found._repr_html_()
    assert all(name in html for name in found.names)
    pytest.importorskip("pandas", reason="pandas comes with the extra notebook")
    frame = found.to_pandas()
    assert frame["lower"].tolist() == pytest.approx(found.low.tolist(), nan_ok=True)
    assert frame["unit"].tolist() == list(found.estimate.likelihood.units[: found.d])
