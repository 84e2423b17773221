"""Types of injectors of which test plans alone are known: what is specified of them, and that they inject as such."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.simulate import simulate_batch
from commonrail.engine.status import OK
from commonrail.readers.injector import load_injector

TYPES = {"cri1-0": 135, "cri2-0": 145, "cri2-1": 160, "cri2-2": 160, "crin1": 160, "crin2": 160, "crin3": 180}
DRIVE = {"boost_voltage", "peak_current", "peak_duration", "hold_current"}
LIFTS = {"valve.lift", "plunger_needle.stop_lift"}


@pytest.mark.parametrize("name", TYPES)
def test_lifts_and_drive_are_specified_and_hydraulics_are_estimated(name: str) -> None:
    injector = load_injector(name)
    specified = {name for name, source in injector.sources.items() if source.mark == "M"}
    # the plans of CRIN2 and CRIN3 state no gap
    gap = set() if name in ("crin2", "crin3") else {"solenoid.residual_gap"}
    assert specified == {f"drive.{key}" for key in DRIVE} | LIFTS | gap
    assert {source.mark for source in injector.sources.values()} == {"M", "E"}
    assert all("part 0445" in injector.sources[key].text for key in specified)
    assert "test plans" in injector.sources["control_chamber.a_hole_diameter"].text
    assert injector.variant == load_injector("crin" if name.startswith("crin") else "cri2-16").variant
    # the spring holds the valve shut against the rail pressure
    values = injector.values
    seat = np.pi / 4.0 * values["valve.seat_diameter"] ** 2
    assert values["valve.spring_preload"] > 1.05 * seat * 1e6 * TYPES[name]


@pytest.mark.parametrize("name", TYPES)
def test_each_injects_at_full_and_mid_load_at_idle_and_as_pilot(name: str) -> None:
    heavy = name.startswith("crin")
    shots = [(TYPES[name], 900e-6), (80, 600e-6), (30, 750e-6), (100 if heavy else 80, 240e-6)]
    points = [OperatingPoint(1e6 * p, t, 0.5e6, 0.1e6) for p, t in shots]
    batch = simulate_batch(load_injector(name), points)
    assert (batch.status == OK).all()
    full, mid, idle, pilot = 1e9 * batch.injected_volume[0]
    assert full > mid > idle > 1.0
    assert mid > pilot
    # pilots of passenger cars are some 1 to 3 mm3, of heavy engines to 5 mm3: half and twice that
    assert 0.5 < pilot < (10.0 if heavy else 6.0)
