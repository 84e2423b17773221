"""Features as targets: the same function for both sides, values without a trace, return quantity, a truth recovered."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from commonrail.base.errors import CommonrailError
from commonrail.calibration.run import calibrate
from commonrail.calibration.study_file import load_study
from commonrail.data.quantities.returned import ReturnData
from commonrail.data.simulator import ITSELF, Simulator
from commonrail.data.study_block import Context
from commonrail.engine.plan import reference_density
from commonrail.engine.simulate import simulate
from commonrail.physics.injector import Injector
from commonrail.physics.meters import Meter
from commonrail.plugins.features import targets as module
from commonrail.plugins.features.run import find_features
from commonrail.plugins.features.table import find_feature
from commonrail.plugins.features.targets import FeatureData
from commonrail.readers.injector_writer import dump_injector
from commonrail.readers.location import Place, Reach
from tests.data.samples import PRESSURES, STEP, curve_table

HEAD = 'kind = "features"\nname = "train"\nrole = "fit"\nrail_pressure = "160 MPa"\n' + PRESSURES
TRAIN = 'energisings = [{ start = "0 us", duration = "300 us" }, { start = "1300 us", duration = "300 us" }]\n'
NAMES = ("opening_delay", "closing_delay", "duration", "rise_time", "fall_time", "peak_rate", "quantity")
TOLERANCES = {"peak_rate": "1 mm3/ms", "quantity": "0.1 mm3"}


def target(name: str, injection: int = 1, more: str = "") -> str:
    """One target with a tolerance."""
    tolerance = TOLERANCES.get(name, "2 us")
    return f'{{ feature = "{name}", injection = {injection}, tolerance = "{tolerance}"{more} }}'


def targets(*items: str) -> str:
    """The key that lists targets."""
    return f"features = [{', '.join(items)}]\n"


ALL = TRAIN + targets(*(target(name, i) for i in (1, 2) for name in NAMES), target("separation", 2))


def read(injector: Injector, folder: Path, keys: str, rates: np.ndarray | None = None) -> Any:
    """Features of a block, with a file if there are rates."""
    file = ""
    if rates is not None:
        (folder / "data.csv").write_text(curve_table(rates), encoding="utf-8")
        file = 'file = "data.csv"\n'
    block = tomllib.loads(HEAD + file + keys)
    context = Context(injector, STEP, Reach(folder / "study.toml", False), Place("study.toml", "data[1]"))
    return FeatureData.read_all(FeatureData.model.model_validate(block), context)[0]


def itself(injector: Injector) -> Simulator:
    return Simulator(injector, (), STEP, 1)


def pulses(height: float = 40e-6) -> np.ndarray:
    """Rates of two injections, whatever their shape."""
    rates = np.zeros(600)
    for first in (60, 320):
        ramps = np.minimum(np.arange(80), np.arange(80)[::-1]) / 20.0
        rates[first : first + 80] = height * np.minimum(1.0, ramps)
    return rates


def simulated_rates(injector: Injector, folder: Path) -> np.ndarray:
    """Simulated rates of the train in samples of 5 us, as a file has them."""
    curve = read(injector, folder, ALL, pulses()).curve
    return np.asarray(curve.simulated(itself(injector), ITSELF)[0])


def test_a_simulated_trace_has_the_same_features_from_a_file(regulated: Injector, tmp_path: Path) -> None:
    data = read(regulated, tmp_path, ALL, simulated_rates(regulated, tmp_path))
    score = data.score(itself(regulated))
    # the file keeps every digit of the rates: what differs is the rounding of a sum
    assert np.abs(data.errors(score.values)).max() < 1e-9
    assert len(data.targets) == 15
    assert np.all(data.measured > 0.0)


def test_measured_and_simulated_features_come_from_one_function(
    regulated: Injector, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken = []

    def noted(source: Any, **more: Any) -> Any:
        taken.append((type(source).__name__, more["settings"], more.get("levels")))
        return find_features(source, **more)

    monkeypatch.setattr(module, "find_features", noted)
    data = read(regulated, tmp_path, ALL, pulses())
    data.simulated(Simulator(regulated, ("valve.mass",), STEP, 1), np.array([[3e-3], [6e-3]]))
    assert [name for name, *_ in taken] == ["RateData", "RateTrace", "RateTrace"]
    assert all(settings == data.settings for _, settings, _ in taken)
    assert [levels for *_, levels in taken] == [None, data.levels, data.levels]
    assert data.levels == find_features(data.curve).levels


def test_features_relate_to_the_figures_of_the_engine(regulated: Injector, tmp_path: Path) -> None:
    """The tip clears 5 um some microseconds before the rate reaches 10 %; the rate ends within some of its seating.

    The needle bounces here: the engine's closing is that of the bounce, `first_closing` that of the injection.
    """
    whole = read(regulated, tmp_path, ALL, pulses()).curve.point
    point = replace(whole, energisings=whole.pulses[:1])
    solution = simulate(regulated, point, time_step=STEP)
    found = find_features(solution)
    assert found.value("opening_delay") == found.value("opening") - point.pulses[0].start
    assert 0.0 < found.value("opening") - solution.opening < 10e-6
    assert abs(found.value("closing") - solution.first_closing) < 10e-6
    assert found.quantity == pytest.approx(solution.injected_volume, rel=1e-9)
    assert found.value("total_quantity") == pytest.approx(solution.injected_volume, rel=1e-6)


def test_values_may_be_stated_and_then_need_no_file(regulated: Injector, tmp_path: Path) -> None:
    stated = targets(
        target("quantity", 2, ', value = "12 mm3"'),
        target("opening_delay", 1, ', value = "230 us"'),
        '{ feature = "quantity", tolerance = "0.1 mg", value = "8 mg" }',
    )
    data = read(regulated, tmp_path, TRAIN + 'threshold = "5 mm3/ms"\n' + stated)
    density = reference_density(regulated, data.curve.point)
    assert data.measured == pytest.approx([12e-9, 230e-6, 8e-6 / density])
    assert data.tolerances[2] == pytest.approx(0.1e-6 / density)
    found = data.simulated(itself(regulated), ITSELF)[0]
    traced = read(regulated, tmp_path, TRAIN + 'threshold = "5 mm3/ms"\n' + stated, pulses())
    same = traced.simulated(itself(regulated), ITSELF)[0]
    # samples of 2 and of 5 us, averaged over one of them: a tenth of the longer one where the ramp is curved
    assert found[1] == pytest.approx(same[1], abs=0.5e-6)
    assert found[[0, 2]] == pytest.approx(same[[0, 2]], rel=1e-4)


def test_a_mass_is_compared_with_a_mass_whatever_the_density(regulated: Injector, tmp_path: Path) -> None:
    stated = targets(
        '{ feature = "quantity", tolerance = "0.1 mg", value = "8 mg" }',
        '{ feature = "quantity", injection = 2, tolerance = "0.1 mm3", value = "9 mm3" }',
        '{ feature = "return_quantity", tolerance = "0.5 mg", value = "16 mg" }',
    )
    data = read(regulated, tmp_path, TRAIN + 'threshold = "5 mm3/ms"\n' + stated)
    density = reference_density(regulated, data.curve.point)
    one = data.simulated(itself(regulated), ITSELF)[0]
    batch = itself(regulated).batch(data.simulated_points, ITSELF, to_horizon=True)
    assert one[2] == pytest.approx(batch.returned_mass[0, -1] / density, rel=1e-12)
    metered = data.changed(meter=Meter("bench", {"density": 0.9 * density})).simulated(itself(regulated), ITSELF)[0]
    # the same mass is a larger volume in the meter; 1e-4: a threshold in mm³/ms is passed a little sooner
    assert metered / one == pytest.approx([1.0, 1.0 / 0.9, 1.0], rel=1e-4)


def test_each_error_counts_in_its_tolerance(regulated: Injector, tmp_path: Path) -> None:
    data = replace(read(regulated, tmp_path, ALL, simulated_rates(regulated, tmp_path)), weight=4.0)
    # 2 us of a time, 1 mm³/ms of a rate, 0.1 mm³ of a quantity
    scale = {"s": 2e-6, "m3/s": 1e-6, "m3": 0.1e-9}
    off = np.array([scale[find_feature(target.feature).unit] for target in data.targets])
    assert data.residuals(data.measured + 2.0 * off) == pytest.approx(np.full(15, 4.0))
    assert data.misfit(data.measured + 2.0 * off) == pytest.approx(15 * 2.0 * (np.sqrt(5.0) - 1.0))


def test_the_return_quantity_is_that_of_a_map(regulated: Injector, tmp_path: Path) -> None:
    keys = TRAIN + 'stroke_period = "40 ms"\n'
    items = target("quantity", 1), '{ feature = "return_quantity", value = "20 mm3", tolerance = "0.5 mm3" }'
    data = read(regulated, tmp_path, keys + targets(*items), pulses())
    (point,) = data.returned.points
    labels = 1.0, "bench", ""
    alone = ReturnData("r", data.role, (point,), [2e-8], 1e-9, 0.0, [False], *labels, stroke_period=40e-3)
    expected = alone.simulated(itself(regulated), ITSELF)[0, 0]
    assert data.simulated(itself(regulated), ITSELF)[0, 1] == expected
    assert len(data.simulated_points) == 2
    assert data.score(itself(regulated)).values[1] == expected > 0.0


def test_a_candidate_without_the_feature_is_told_with_the_reason(regulated: Injector, tmp_path: Path) -> None:
    """A threshold above any simulated rate: nothing is injected in its eyes."""
    data = read(regulated, tmp_path, 'threshold = "300 mm3/ms"\n' + ALL, pulses(1e-3))
    score = data.score(itself(regulated))
    missing = score.missing()
    assert len(missing) == 15
    assert missing[0].status == "NO_FEATURE"
    assert missing[0].sentence.startswith("opening_delay 1: ")
    assert not np.isfinite(data.misfit(score.values))


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        (TRAIN + targets(target("quantity", 3)), r"features\[1\]\.injection: "),
        (TRAIN + targets(target("quantity"), target("quantity")), r"features: quantity 1\b"),
        (TRAIN + targets(target("separation", 1)), "separation of injection 1"),
        (TRAIN + targets('{ feature = "return_quantity", tolerance = "1 mm3" }'), r"features\[1\]\.value: "),
        (TRAIN + 'threshold = "2 bar"\n' + targets(target("quantity")), "threshold"),
        (TRAIN + targets('{ feature = "quantity", tolerance = "0 mm3" }'), r"features\[1\]\.tolerance: "),
    ],
)
def test_a_target_that_makes_no_sense_is_refused(regulated: Injector, tmp_path: Path, keys: str, words: str) -> None:
    with pytest.raises(CommonrailError, match=words) as caught:
        read(regulated, tmp_path, keys, pulses())
    assert "study.toml, data[1]" in str(caught.value)


@pytest.mark.parametrize(
    ("item", "words"),
    [
        (target("quantty"), "quantity"),
        ('{ feature = "quantity", tolerance = "2 us" }', "a volume"),
        ('{ feature = "quantity" }', "tolerance"),
    ],
)
def test_a_target_of_the_wrong_form_is_refused(regulated: Injector, tmp_path: Path, item: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        read(regulated, tmp_path, TRAIN + targets(item), pulses())


STUDY = """
format = "commonrail-study/1"
title = "Truth recovered from features"
injector = "start.toml"
time_step = "1 us"
loss = "squares"

[[data]]
kind = "features"
name = "train"
role = "fit"
file = "data.csv"
rail_pressure = "160 MPa"
cylinder_pressure = "5 MPa"
return_pressure = "0.5 MPa"
source = "simulated"
synthetic = "all of it"

[[parameter]]
name = "control_chamber.z_hole_diameter"
below = "10 %"
above = "10 %"

[[parameter]]
name = "nozzle.discharge_maximum"
lower = 0.7
upper = 0.95

[optimiser]
method = "multi-start least squares"
members = 16
starts = 2
generations = 40
"""


def test_a_calibration_to_features_recovers_the_truth(regulated: Injector, tmp_path: Path) -> None:
    """Two parameters by eight features of a train; the file keeps every digit, so that the truth costs nothing."""
    truth = {"control_chamber.z_hole_diameter": 0.209e-3, "nozzle.discharge_maximum": 0.86}
    rates = simulated_rates(regulated.with_values(truth), tmp_path)
    (tmp_path / "data.csv").write_text(curve_table(rates), encoding="utf-8")
    dump_injector(regulated, tmp_path / "start.toml", {})
    names = "opening_delay", "closing_delay", "quantity", "peak_rate"
    items = [target(name, i) for i in (1, 2) for name in names]
    text = STUDY.replace('source = "simulated"\n', 'source = "simulated"\n' + TRAIN + targets(*items))
    (tmp_path / "study.toml").write_text(text, encoding="utf-8")
    found = calibrate(load_study(tmp_path / "study.toml"), threads=1)
    # the search has converged: J is 1e-18, and the differences of its last steps are rounding
    assert found.best["control_chamber.z_hole_diameter"] == pytest.approx(0.209e-3, rel=1e-8)
    assert found.best["nozzle.discharge_maximum"] == pytest.approx(0.86, rel=1e-8)
