"""Both engines on random trains of injections: later pulses meet what the earlier ones left in the return line."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from commonrail.base.choices import Actuation, Drive
from commonrail.engine.operating_point import Energising, OperatingPoint
from commonrail.engine.reference import Resolution, simulate_reference
from commonrail.engine.simulate import simulate
from commonrail.physics.injector import Injector
from commonrail.readers.injector import injector_catalogue, load_injector

TRAINS, SEED = 200, 20161201
DWELLS = (0.2e-3, 2e-3)  # [s]
RETURN = (0.1e6, 3e6)  # return pressures [Pa]
AGREE, SOME = 3e-3, 1e-11  # of the volume [1], or that volume [m³]
SHARE = 0.99  # of the trains that agree so far
COARSE = Resolution((60, 1), 1e-6, 5e-6)  # of a direct-acting injector: a tenth of the time


class Train(NamedTuple):
    """An injector of the catalogue, at a point of several energisings."""

    name: str
    point: OperatingPoint


class Outcome(NamedTuple):
    """Volumes of fast engine and reference [m³], and whether they ended alike."""

    fast: float
    exact: float
    alike: bool


def injector_of(name: str) -> Injector:
    """Entry of the catalogue, the current of one that is driven by a trace regulated instead."""
    injector = load_injector(name)
    traced = injector.variant.drive in (Drive.CURRENT, Drive.VOLTAGE)
    return replace(injector, variant=injector.variant._replace(drive=Drive.REGULATED)) if traced else injector


def draw(rng: np.random.Generator) -> Train:
    """Any of the catalogue at a rail pressure and with energising times that it is made for."""
    name = str(rng.choice(injector_catalogue()))
    direct = load_injector(name).variant.actuation is Actuation.DIRECT
    rail = rng.uniform(*((10e6, 30e6) if direct else (60e6, 180e6)))
    times = rng.uniform(*((400e-6, 900e-6) if direct else (250e-6, 700e-6)), rng.integers(2, 5))
    starts = np.concatenate(([0.0], np.cumsum(times[:-1] + rng.uniform(*DWELLS, len(times) - 1))))
    pulses = tuple(Energising(float(t), float(d)) for t, d in zip(starts, times, strict=True))
    return Train(name, OperatingPoint(float(rail), pulses, return_pressure=float(rng.uniform(*RETURN))))


def outcome(train: Train) -> Outcome:
    """Both engines on a train, the reference by the method that the injector has."""
    injector = injector_of(train.name)
    direct = injector.variant.actuation is Actuation.DIRECT
    exact = simulate_reference(injector, train.point, 3e-6, COARSE if direct else Resolution(method="explicit"))
    fast = simulate(injector, train.point)
    alike = fast.status is exact.status and not fast.status.failed
    return Outcome(fast.injected_volume, exact.injected_volume, alike)


@pytest.mark.slow
def test_engines_agree_on_random_trains() -> None:
    rng = np.random.default_rng(SEED)
    trains = [draw(rng) for _ in range(TRAINS)]
    with ProcessPoolExecutor() as pool:
        outcomes = list(pool.map(outcome, trains))
    error = np.array([abs(o.fast - o.exact) / max(AGREE * o.exact, SOME) if o.alike else np.inf for o in outcomes])
    worst = int(np.argmax(error))
    kept = float(np.mean(error <= 1.0))
    summary = f"{100.0 * kept:g} % agree; the worst by {error[worst]:.2g} limits: {trains[worst]}, {outcomes[worst]}"
    print(summary)
    assert all(o.exact > SOME for o in outcomes)  # each injects
    assert kept >= SHARE, summary
