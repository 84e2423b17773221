"""The virtual test bench: repeatable shots, a fit that can see the truth, sensors and scatter as declared."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from commonrail.base.choices import Body
from commonrail.base.errors import SimulationError
from commonrail.engine.operating_point import OperatingPoint, Trace
from commonrail.engine.simulate import simulate
from commonrail.physics.injector import Injector
from commonrail.plugins.paper.bench import INTERVAL, PAPER_OPTIMUM, SAMPLES, Curve, Scatter, Sensor, Truth, bench_curve

ENERGISING = 700e-6
COARSE = (60, 30)  # cells: nothing here asks how fine they are


@pytest.fixture(scope="module")
def bare(ideal: Truth) -> Truth:
    """The ideal truth on coarse pipes."""
    return replace(ideal, resolution=ideal.resolution._replace(cells=COARSE))


def shoot(truth: Truth, injector: Injector, seed: int = 1, pressure: float = 160e6) -> Curve:
    return bench_curve(truth, injector, pressure, ENERGISING, seed)


def j(curve: Curve, injector: Injector, energising: float = ENERGISING) -> float:
    """J of the fast engine, fed with the measured inlet pressure [mm3/ms]."""
    point = OperatingPoint(Trace.of(curve.trace_time, curve.rail), energising, horizon=SAMPLES * INTERVAL)
    found = simulate(injector, point, sample_interval=INTERVAL)
    return float(np.sum(np.abs(found.rate - curve.rate)) * 1e6)


def same(one: Curve, other: Curve) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


def test_a_curve_depends_on_its_arguments_alone(truth: Truth, pwm: Injector) -> None:
    keys = [(1, 160e6), (1, 80e6), (2, 160e6)]
    coarse = replace(truth, resolution=truth.resolution._replace(cells=COARSE))
    alone = [shoot(coarse, pwm, seed, pressure) for seed, pressure in keys]
    with ThreadPoolExecutor(3) as pool:
        together = [pool.submit(shoot, coarse, pwm, seed, pressure) for seed, pressure in reversed(keys)]
    assert all(same(a, b.result()) for a, b in zip(alone, reversed(together), strict=True))
    assert not same(alone[0], alone[2])


def test_a_curve_has_520_samples(bare: Truth, pwm: Injector) -> None:
    curve = shoot(bare, pwm)
    assert len(curve.time) == len(curve.rate) == len(curve.trace_time) == len(curve.rail) == 520
    assert curve.time[0] == pytest.approx(3e-6, rel=1e-12)
    assert curve.time[-1] == pytest.approx(1.56e-3, rel=1e-12)


def test_an_ideal_truth_is_the_same_for_all_seeds(bare: Truth, pwm: Injector) -> None:
    assert same(shoot(bare, pwm, 1), shoot(bare, pwm, 2))


@pytest.mark.parametrize("pressure", [160e6, 80e6])
def test_the_inlet_pressure_explains_the_curve(ideal: Truth, pwm: Injector, pressure: float) -> None:
    """The fitted model, an ideal inlet at the measured pressure, contains the truth: J of the true k is nothing."""
    curve = shoot(ideal, pwm, pressure=pressure)
    true, theoretical = j(curve, pwm.with_values(PAPER_OPTIMUM)), j(curve, pwm)
    print(f"J: true k {true:.1f}, theoretical k {theoretical:.1f} mm3/ms")
    # the lanes' own error at 1 us, 0.1 % of the rates' sum, and the trace's, taken every 3 us
    assert true < 1e-3 * np.sum(curve.rate) * 1e6
    assert true < 0.01 * theoretical


def test_the_pressure_asked_for_does_not_explain_it(bare: Truth, pwm: Injector) -> None:
    curve = shoot(bare, pwm)
    assert np.ptp(curve.rail) > 5e6  # the injector's own waves
    without = replace_rail(curve, 160e6)
    true = pwm.with_values(PAPER_OPTIMUM)
    assert j(without, true) > 10 * j(curve, true)


def replace_rail(curve: Curve, pressure: float) -> Curve:
    return curve._replace(rail=np.full_like(curve.rail, pressure))


def test_the_models_are_in_the_papers_order(truth: Truth, pwm: Injector) -> None:
    rigid = replace(pwm, variant=pwm.variant._replace(body=Body.RIGID))
    for pressure in (160e6, 120e6, 80e6):
        curve = shoot(truth, pwm, 1, pressure)
        assert j(curve, rigid) > 3 * j(curve, pwm) > 3 * j(curve, pwm.with_values(PAPER_OPTIMUM))


def test_the_rate_meters_noise_is_what_is_declared(truth: Truth, pwm: Injector) -> None:
    meter = replace(truth.rate_meter, resolution=0.0)
    noisy, quiet = (
        shoot(replace(truth, rate_meter=replace(meter, noise=noise)), pwm).rate for noise in (truth.rate_meter.noise, 0)
    )
    # four standard errors of a deviation of 520 samples
    assert np.std(noisy - quiet) == pytest.approx(0.3e-6, rel=4 / np.sqrt(2 * 520))


def test_rate_and_rail_noise_are_independent(bare: Truth, pwm: Injector) -> None:
    noisy = replace(bare, rate_meter=Sensor(noise=1e-6), rail_sensor=Sensor(noise=1e6))
    one, quiet = shoot(noisy, pwm), shoot(bare, pwm)
    other = shoot(replace(bare, rail_sensor=Sensor(noise=1e6)), pwm)
    assert abs(np.corrcoef(one.rate - quiet.rate, one.rail - quiet.rail)[0, 1]) < 4 / np.sqrt(520)
    np.testing.assert_array_equal(one.rail, other.rail)
    np.testing.assert_array_equal(other.rate, quiet.rate)


def test_pressures_of_one_seed_have_noise_of_their_own(bare: Truth, pwm: Injector) -> None:
    noisy = replace(bare, rate_meter=Sensor(noise=1e-6))
    a, b = ((shoot(noisy, pwm, 1, p).rate - shoot(bare, pwm, 1, p).rate) for p in (160e6, 120e6))
    assert abs(np.corrcoef(a, b)[0, 1]) < 4 / np.sqrt(520)


def test_the_rail_scatters_as_declared(bare: Truth, pwm: Injector) -> None:
    def deviation(spread: float, seed: int) -> float:
        return float(shoot(replace(bare, scatter=Scatter(rail_pressure=spread)), pwm, seed).rail[0]) - 160e6

    shots = [deviation(1e6, seed) for seed in (1, 2, 3)]
    assert len(set(shots)) == 3
    assert max(map(abs, shots)) < 4e6  # four standard deviations
    # 3 us after the start the pipe has moved by some Pa
    assert deviation(0.5e6, 1) == pytest.approx(0.5 * shots[0], abs=1e3)


def test_the_energising_time_scatters_and_is_not_told(bare: Truth, pwm: Injector) -> None:
    spread = 20e-6
    shots = [shoot(replace(bare, scatter=Scatter(energising_time=spread)), pwm, seed) for seed in (1, 2)]
    assert shots[0].rail[0] == shots[1].rail[0]
    true = pwm.with_values(PAPER_OPTIMUM)
    for shot, seed in zip(shots, (1, 2), strict=True):
        rng = np.random.default_rng(np.random.SeedSequence((seed, 160_000_000)).spawn(3)[0])
        actual = ENERGISING + spread * rng.standard_normal(3)[1]
        # told the duration, the model explains the curve as well as it can
        assert j(shot, true, actual) < 1e-3 * np.sum(shot.rate) * 1e6 < j(shot, true)


def test_the_boost_voltage_scatters(bare: Truth, pwm: Injector) -> None:
    shots = [shoot(replace(bare, scatter=Scatter(boost_voltage=5.0)), pwm, seed) for seed in (1, 2)]
    assert not np.array_equal(shots[0].rate, shots[1].rate)


def test_guide_friction_is_in_the_truth(truth: Truth, bare: Truth, pwm: Injector) -> None:
    """It holds the needle back while it opens, and again while it closes."""
    rubbed, free = shoot(replace(bare, friction=truth.friction), pwm).rate, shoot(bare, pwm).rate
    opening, closing = slice(0, int(np.argmax(free))), slice(int(np.argmax(free)), None)
    assert np.sum(rubbed[opening]) < 0.99 * np.sum(free[opening])
    assert np.sum(rubbed[closing]) > 1.001 * np.sum(free[closing])


def test_a_truth_that_cannot_be_simulated_says_why(bare: Truth, pwm: Injector) -> None:
    thin = replace(bare, values={**bare.values, "plunger_needle.plunger_diameter": 1e-3})
    with pytest.raises(SimulationError, match=r"virtual-lino-2016-ideal at 160 MPa: .*rest"):
        shoot(thin, pwm)
