"""Populations in parts: the same bits as whole, and memory that does not grow with them."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from commonrail.base.choices import Precision
from commonrail.base.errors import ConfigurationError
from commonrail.engine import simulate as engine
from commonrail.engine.lanes import Misfit
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.simulate import simulate_batch
from commonrail.physics.injector import Injector
from tests.engine.test_batch import POINTS, K, failing, same_bits, stiffnesses

BOUNDS = np.linspace(0.0, 1200.0, 401) + 0.3  # [steps]
TARGET, WEIGHT = np.full((2, 401), 2.4e-5), np.ones((2, 401))
SAMPLES = Misfit(np.array([401, 301]), np.tile(BOUNDS, (2, 1)), TARGET, WEIGHT, np.full((1, 2), np.nan))


@pytest.mark.parametrize("precision", list(Precision))
@pytest.mark.parametrize("part", [1, 2, 6, 34, 41])
def test_parts_give_the_same_bits_as_the_whole(
    pwm: Injector, monkeypatch: pytest.MonkeyPatch, part: int, precision: Precision
) -> None:
    """Parts of one candidate (fewer simulations than points, too), of three, of seventeen, and a last one of one."""
    values = failing(pwm, stiffnesses(pwm, 41))
    settings = {"misfit": SAMPLES, "precision": precision, "threads": 1}
    whole = simulate_batch(pwm, POINTS, K, values, **settings)
    parts = []
    monkeypatch.setattr(engine, "AT_A_TIME", {engine.Engine.LANES: part})
    inner = engine._simulate
    monkeypatch.setattr(engine, "_simulate", lambda *a: parts.append(len(a[1])) or inner(*a))
    streamed = simulate_batch(pwm, POINTS, K, values, **settings)
    many = max(part // 2, 1)
    assert parts == [min(many, 41 - first) for first in range(0, 41, many)]
    same_bits(whole, streamed, slice(None), slice(None))
    assert whole.failed[1:6].all()
    assert not whole.failed[6:].any()
    assert np.array_equal(streamed.reference_density, whole.reference_density)
    assert streamed.absolute_error.shape == (41, 2)


def test_a_population_of_nobody_is_refused(regulated: Injector) -> None:
    with pytest.raises(ConfigurationError, match="one candidate"):
        simulate_batch(regulated, POINTS, K, np.empty((0, 7)))


def test_a_large_population_takes_little_memory_beyond_its_own(regulated: Injector) -> None:
    count = 200_000
    point = OperatingPoint(160e6, 5e-6, horizon=10e-6)  # ten steps: only memory is asked for
    values = stiffnesses(regulated, count)
    tracemalloc.start()
    try:
        batch = simulate_batch(regulated, [point], K, values, threads=1)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    print(f"peak: {peak / 1e6:.0f} MB")
    assert batch.injected_mass.shape == (count, 1)
    # 45 to 57 MB were seen: parameters and figures of one part (20 MB), figures twice while they are joined (25 MB).
    # Whole, it takes 224 MB: 114 parameters and fuel coefficients of 8 bytes each for 200,000.
    assert peak < 100e6
