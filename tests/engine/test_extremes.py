"""Injectors and schedules at the edge of what is usual: the figure is right, or the status says that it is not."""

from __future__ import annotations

from dataclasses import replace

import pytest

from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.simulate import simulate_batch
from commonrail.engine.status import Status
from commonrail.physics.injector import Injector
from commonrail.physics.variants import Variant
from commonrail.readers.injector import load_injector

# Relative; what a step of 1 us may miss where the valve's switching is as coarse as here. Each test names what was
# missed before.
NEAR = 0.02


def injected(injector: Injector, point: OperatingPoint, step: float, stop: bool = True) -> float:
    """Injected volume [mm³] of a simulation that must have ended well."""
    batch = simulate_batch(injector, [point], time_step=step, threads=1, stop_when_closed=stop)
    assert batch.status.tolist() == [[Status.OK]]
    return float(batch.injected_volume[0, 0]) * 1e9


def status(injector: Injector, point: OperatingPoint, step: float) -> int:
    return int(simulate_batch(injector, [point], time_step=step, threads=1).status[0, 0])


@pytest.mark.parametrize("name", ["virtual-lino-2016", "cri2-16"])
def test_pwm_whose_voltage_crosses_its_band_in_a_step(name: str) -> None:
    """Quench of 500 V: the current fell by several bands in one step, 2.6 and 15 % of the volume were missing."""
    injector = replace(load_injector(name), variant=Variant("rigid", "ideal", "pwm"))
    fast = injector.with_values({"drive.quench_voltage": 500.0})
    point = OperatingPoint(80e6, 300e-6)
    assert injected(fast, point, 1e-6) == pytest.approx(injected(fast, point, 0.125e-6), rel=NEAR)


def test_energisings_without_a_pause_are_one(rigid: Injector) -> None:
    """The step in which one ended and the next began was dead for the share of the first."""
    flat = rigid.with_values({"drive.peak_current": 12.0, "drive.hold_current": 12.0})
    single = OperatingPoint(120e6, [(10e-6, 600e-6)])
    parted = OperatingPoint(120e6, [(10e-6, 300.3e-6), (310.3e-6, 299.7e-6)])
    # rounding of the times: 1e-12 s of 600 us
    assert injected(flat, parted, 1e-6) == pytest.approx(injected(flat, single, 1e-6), rel=1e-6)


def test_a_heavy_needle_that_leaves_its_seat_again_is_waited_for(rigid: Injector) -> None:
    """A quarter of a kilogram touches its seat for longer than the rest that ends a simulation: 18 % were lost."""
    heavy = rigid.with_values({"plunger_needle.m2": 0.241, "plunger_needle.spring_preload": 2.1})
    point = OperatingPoint(100e6, 371.59e-6)
    # what dribbles after rest is far below 1e-4
    assert injected(heavy, point, 0.5e-6) == pytest.approx(injected(heavy, point, 0.5e-6, stop=False), rel=1e-4)


def test_a_needle_whose_stop_is_far_is_not_past_it(rigid: Injector) -> None:
    """A needle counted as past its stop at 2 mm, whatever the stop."""
    far = rigid.with_values({"plunger_needle.stop_lift": 3e-3, "control_chamber.volume": 200e-9})
    batch = simulate_batch(far, [OperatingPoint(160e6, 5e-3, horizon=5.5e-3)])
    assert batch.status[0, 0] == Status.STILL_INJECTING
    # 0.1 mm: the stop gives way by some micrometres
    assert batch.greatest_lift[0, 0] == pytest.approx(3e-3, abs=0.1e-3)


def test_a_sac_larger_than_the_accumulation_volume(rigid: Injector) -> None:
    """Flow through the seat alternated from step to step: 30 % too much, status OK."""
    odd = rigid.with_values({"accumulation.volume": 8e-9, "sac.volume": 16e-9})
    point = OperatingPoint(30e6, [(0.0, 250e-6), (400e-6, 900e-6)])
    assert status(odd, point, 5e-6) == Status.STEP_UNSTABLE
    assert status(odd, point, 0.5e-6) == Status.OK


def test_a_rail_that_a_wave_empties_in_a_step(volume: Injector, pwm: Injector) -> None:
    """1 mm³: 47 instead of 29 mm³ with a rigid body, status OK."""
    tiny = volume.with_values({"rail.volume": 1e-9})
    assert status(tiny, OperatingPoint(160e6, 700e-6), 1e-6) == Status.STEP_UNSTABLE
    # an ideal rail has no volume
    assert status(replace(tiny, variant=pwm.variant), OperatingPoint(160e6, 700e-6), 1e-6) == Status.OK


def test_a_control_chamber_that_the_plunger_fills(rigid: Injector) -> None:
    """1.5 mm³ under a plunger that takes 3: 12.5 mm³ at one step, 8.8 at its half, both OK."""
    flat = rigid.with_values({"control_chamber.volume": 1.46e-9})
    assert status(flat, OperatingPoint(73e6, 367e-6), 1.286e-6) == Status.STEP_UNSTABLE


def test_an_injector_that_has_run_empty(regulated: Injector) -> None:
    """Leaking guides empty the rail until fuel comes back through the nozzle: −0.48 mm³ were OK."""
    leaking = replace(
        regulated.with_values({"plunger_needle.needle_gap": 7.45e-5, "plunger_needle.k1": 2.5e8}),
        variant=Variant("flexible", "volume", "regulated"),
    )
    assert status(leaking, OperatingPoint(96e6, 679e-6, 15e6), 1e-6) == Status.NOT_FINITE
