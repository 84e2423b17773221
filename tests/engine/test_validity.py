"""Inputs outside the model's validity are refused; traces and balances do not falsify a simulation."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from commonrail.base import hooks
from commonrail.base.errors import ConfigurationError
from commonrail.engine import plan, status
from commonrail.engine.operating_point import OperatingPoint, Trace
from commonrail.engine.reference import Resolution, simulate_reference
from commonrail.engine.simulate import simulate, simulate_batch
from commonrail.engine.status import Status
from commonrail.physics.fuel import Fuel
from commonrail.physics.injector import Injector, parameter_quantities
from commonrail.physics.law import Domain
from commonrail.readers.injector import load_injector

COARSE = Resolution((20, 10))


@pytest.mark.parametrize(
    ("point", "says"),
    [
        (OperatingPoint(300e6, 1e-3), r"rail pressure .*300 MPa, .*iso4113 .* 0 to 250 MPa"),
        (OperatingPoint(Trace((0.0, 1.0), (200e6, 251e6)), 1e-3), "rail pressure .*251 MPa"),
    ],
)
def test_pressures_outside_the_fuels_range_are_refused(regulated: Injector, point: OperatingPoint, says: str) -> None:
    with pytest.raises(ConfigurationError, match=says):
        simulate(regulated, point)
    with pytest.raises(ConfigurationError, match=says):
        simulate_reference(regulated, point, resolution=COARSE)
    with pytest.raises(ConfigurationError, match=says):
        simulate_batch(regulated, [point])


def test_the_ends_of_the_fuels_range_are_admitted(regulated: Injector) -> None:
    assert simulate(regulated, OperatingPoint(250e6 * (1.0 + 1e-12), 100e-6, horizon=150e-6)).status.failed is False


def test_a_trace_of_a_rail_that_is_a_volume_is_refused(volume: Injector) -> None:
    point = OperatingPoint(Trace((0.0, 1e-3), (160e6, 150e6)), 500e-6)
    for run in (simulate, lambda i, p: simulate_reference(i, p, resolution=COARSE)):
        with pytest.raises(ConfigurationError, match=r'rail_boundary .*"ideal".*one number'):
            run(volume, point)


COEFFICIENTS = [name for name, q in parameter_quantities().items() if q.domain is Domain.COEFFICIENT]


def test_every_discharge_coefficient_is_bounded_by_one() -> None:
    named = {n for n in parameter_quantities() if "discharge" in n} - {
        "nozzle.discharge_growth",  # 1/Pa
        "nozzle.discharge_memory",  # s
    }
    assert set(COEFFICIENTS) == named
    assert len(named) == 7


def test_a_contraction_beyond_one_switches_cavitation_off(regulated: Injector) -> None:
    """It is a limit of the flow, not a factor: of two that are never reached none matters."""
    names = ("nozzle.contraction", "control_chamber.a_hole_contraction", "control_chamber.z_hole_contraction")
    point = OperatingPoint(160e6, 300e-6, horizon=600e-6)
    batch = simulate_batch(regulated, [point], names, np.array([[3.0] * 3, [8.0] * 3]))
    assert batch.injected_mass[0] == batch.injected_mass[1]
    assert not batch.failed.any()


@pytest.mark.parametrize("name", COEFFICIENTS)
def test_a_coefficient_above_one_is_refused(regulated: Injector, name: str) -> None:
    with pytest.raises(ConfigurationError, match=rf"{name}.* 1, .*\b8\b"):
        regulated.with_values({name: 8.0})
    batch = simulate_batch(regulated, [OperatingPoint(160e6, 20e-6, horizon=30e-6)], (name,), np.array([[1.0], [8.0]]))
    assert batch.status[1, 0] == Status.OUTSIDE_DOMAIN
    assert batch.status[0, 0] != Status.OUTSIDE_DOMAIN


@pytest.mark.parametrize("excess", [{"nozzle.discharge_growth": 4.9e-9}, {"nozzle.shape_5": 0.5}])
def test_a_discharge_coefficient_that_is_held_at_one_is_told(regulated: Injector, excess: dict[str, float]) -> None:
    point = OperatingPoint(160e6, 20e-6, horizon=30e-6)
    for injector, count in ((regulated, 0), (regulated.with_values(excess), 1)):
        for prepare in (lambda i: plan.prepare(i, [point], 1e-6), lambda i: simulate_reference(i, point, 3e-6, COARSE)):
            hooks._noted.clear()
            with warnings.catch_warnings(record=True) as told:
                warnings.simplefilter("always")
                prepare(injector)
            assert len([each for each in told if "discharge coefficient" in str(each.message)]) == count


# 0.3 m of 1 mm and f = 0.03: the engines are 0.03 % apart; 1 m: 0.75 %; 1 m of 2 mm and f = 0.1: 0.08 %
@pytest.mark.parametrize(
    ("pipe", "count"), [((0.3, 1e-3, 0.03), 0), ((1.0, 2e-3, 0.1), 0), ((1.0, 1e-3, 0.03), 1), ((1.0, 1.5e-3, 0.1), 1)]
)
def test_a_pipe_that_rubs_more_than_is_resolved_is_told(
    regulated: Injector, pipe: tuple[float, float, float], count: int
) -> None:
    names = ("feed_pipe.length", "feed_pipe.diameter", "feed_pipe.friction_factor")
    hooks._noted.clear()
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        plan.prepare(regulated.with_values(dict(zip(names, pipe, strict=True))), [OperatingPoint(160e6, 700e-6)], 1e-6)
    assert len([each for each in told if "feed pipe" in str(each.message)]) == count


def test_another_batch_at_the_same_point_judges_no_pipe_anew(
    regulated: Injector, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The speed of sound takes as long as a twentieth of a batch of 512."""
    point = OperatingPoint(160e6, 700e-6)
    plan.prepare(regulated, [point], 1e-6)
    monkeypatch.setattr(Fuel, "sound_speed", None)  # to compute it is a fault
    plan.prepare(regulated.with_values({"nozzle.holes": 8.0}), [point], 1e-6)


def test_no_pipe_of_the_catalogue_rubs_so_much() -> None:
    for name in ("virtual-lino-2016", "cri2-16", "crin", "direct-acting-kr"):
        assert status.pipe_loss(load_injector(name), 180e6) < status.MOST_LOSS


def test_the_rail_pressure_is_a_channel_of_both_engines(regulated: Injector) -> None:
    trace = Trace((-20e-6, 21e-6, 60e-6), (121e6, 120e6, 118e6))
    point = OperatingPoint(trace, 0.0, horizon=90e-6)
    fast, slow = simulate(regulated, point, sample_interval=10e-6), simulate_reference(regulated, point, 10e-6, COARSE)
    assert np.array_equal(fast.channels["rail_pressure"], trace.at(fast.time))
    assert fast.channels["rail_pressure"] == pytest.approx(slow.channels["rail_pressure"], rel=1e-12)  # of the times


@pytest.mark.parametrize("duration", [0.0, 20e-6])
def test_the_balance_has_a_scale_without_an_injection(pwm: Injector, duration: float) -> None:
    point = OperatingPoint(160e6, duration, horizon=400e-6)
    fast, slow = simulate(pwm, point), simulate_reference(pwm, point, resolution=COARSE)
    assert max(fast.injected_mass, slow.injected_mass) < 1e-9
    # rounding of some 1e-3 kg in the volumes; of LSODA, 1e-8 of the fuel in the pipe
    assert abs(fast.balance) < 1e-9
    assert abs(slow.balance) < 1e-3
