"""Laws beyond the paper's: the fast engine against the reference with each of them on, and a needle at its stop."""

from __future__ import annotations

import math

import numpy as np
import pytest

from commonrail.base.choices import Laws
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.reference import Resolution, simulate_reference
from commonrail.engine.simulate import simulate, simulate_batch
from commonrail.physics.injector import Injector
from commonrail.physics.variants import EXTENDING
from commonrail.readers.injector import load_injector

SHAPE = {f"nozzle.shape_{i}": value for i, value in enumerate((-0.28, 0.07, -0.14, -0.2, -0.08), start=1)}
LAWS = {
    "shape": SHAPE,
    "land of the valve": {"valve.seat_land": 100e-6},
    "viscous friction": {"plunger_needle.viscous": 20.0},
    "dry friction": {"plunger_needle.friction": 10.0},
    "squeeze films": {
        "valve.stop_disc": 8e-3,
        "valve.stop_film": 20e-6,
        "valve.seat_disc": 4e-3,
        "valve.seat_film": 10e-6,
    },
    "guides that widen": {"plunger_needle.gap_widening": 2e-14, "plunger_needle.eccentricity": 0.5},
}
ALL = {name: value for one in LAWS.values() for name, value in one.items()} | {"nozzle.discharge_growth": 2e-10}
POINT = OperatingPoint(100e6, 500e-6, horizon=2e-3)


@pytest.mark.parametrize("law", ["all", *(pytest.param(law, marks=pytest.mark.slow) for law in LAWS)])
def test_engines_agree_with_each_law(regulated: Injector, law: str) -> None:
    """Volume within 0.05 %, instants within 0.5 us: limits that `commonrail lab verify` sets for the paper's laws."""
    plain = simulate(regulated, POINT)
    injector = regulated.with_values(ALL if law == "all" else LAWS[law])
    fast, exact = simulate(injector, POINT), simulate_reference(injector, POINT, resolution=Resolution((60, 30)))
    assert fast.injected_mass == pytest.approx(exact.injected_mass, rel=5e-4)
    assert (fast.opening, fast.closing) == pytest.approx((exact.opening, exact.closing), abs=0.5e-6)
    # the comparison sees the law: without it the engines would be apart by more than these limits
    assert abs(fast.injected_mass / plain.injected_mass - 1.0) > 2e-3 or abs(fast.closing - plain.closing) > 5e-6


@pytest.mark.parametrize("drive", ["regulated", "pwm"])
def test_a_varying_law_is_computed_where_the_injector_has_none(request: pytest.FixtureRequest, drive: str) -> None:
    injector = request.getfixturevalue(drive)
    names = ["plunger_needle.friction", "nozzle.shape_2"]
    values = {"plunger_needle.friction": 10.0, "nozzle.shape_2": 0.07}
    alone = simulate_batch(injector.with_values(values), [POINT])
    among = simulate_batch(injector, [POINT], names, [[0.0, 0.0], [10.0, 0.07]])
    assert among.injected_mass[1, 0] == alone.injected_mass[0, 0]
    # at zero the extended laws are the paper's, in another order of sums
    assert among.injected_mass[0, 0] == pytest.approx(simulate_batch(injector, [POINT]).injected_mass[0, 0], rel=1e-9)


def test_only_what_needs_them_has_the_extended_laws(regulated: Injector) -> None:
    assert regulated.wired() == regulated.variant
    assert regulated.wired(["nozzle.discharge_growth", "drive.diode_voltage"]).laws is Laws.PAPER
    for name in EXTENDING:
        assert regulated.wired([name]).laws is Laws.EXTENDED
        assert regulated.with_values({name: 1e-3}).wired().laws is Laws.EXTENDED
    assert regulated.wired(["nozzle.shape_1"]).label == f"{regulated.variant.label}, extended laws"


@pytest.mark.parametrize("pressure", [80e6, 120e6, 160e6])
def test_beyond_its_knee_the_quantity_grows_with_the_nozzles_steady_flow(pressure: float) -> None:
    """A needle at its stop, published: dQ/dET is 0.93 to 1.05 of the catalogue flow after the knee, more before it."""
    injector = load_injector("crin")
    times = np.array([500e-6, 700e-6, 1500e-6, 2000e-6])
    points = [OperatingPoint(pressure, float(t), 0.5e6, 0.1e6) for t in times]
    batch = simulate_batch(injector, points)
    volume = batch.injected_mass[0] / batch.reference_density[0]
    catalogue = 900e-6 / 30 * math.sqrt(pressure / 10e6)  # [m³/s]
    before, _, after = np.diff(volume) / np.diff(times) / catalogue
    # at the stop; what the longer energising adds is the compression that recovers, some micrometres
    assert batch.greatest_lift[0, 3] == pytest.approx(batch.greatest_lift[0, 2], rel=0.02)
    assert batch.greatest_lift[0, 3] > injector.values["plunger_needle.stop_lift"]
    # 0.85: no pump refills the rail of the model, whose pressure falls by a tenth at 2 ms
    assert 0.85 < after < 1.05
    assert before > 1.3 * after
