"""The case that is measured: the injector of the paper at 160 MPa, and the paper's study on synthetic data."""

from __future__ import annotations

import functools

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.calibration.study import Method, Study
from commonrail.data.curves.data import RateData
from commonrail.engine.operating_point import OperatingPoint
from commonrail.physics.injector import Injector
from commonrail.plugins.paper import study
from commonrail.plugins.paper.bench import Bench
from commonrail.plugins.paper.bench_file import load_truth
from commonrail.plugins.paper.run import measure
from commonrail.readers.injector import (
    load_injector,
)

INJECTOR = "virtual-lino-2016"
POINT = OperatingPoint(160e6, study.ENERGISING_TIME, horizon=1.56e-3)
INTERVAL = 3e-6  # between samples of the rate [s]
TIME_STEP = 1e-6  # [s]
LONG_STEP = POINT.duration / 832  # 1.875 us: the case and its candidates stay within an L1 error of 0.1 % [s]
SPREAD = 0.2  # candidates lie within this share of the drawn stiffness
CASE = "virtual-lino-2016, flexible body, PWM; 160 MPa, 700 us, 1.56 ms simulated, 520 samples"


@functools.cache
def injector() -> Injector:
    """The injector of every measurement."""
    return load_injector(INJECTOR)


def candidates(count: int) -> Floats:
    """Stiffnesses k1 to k7 (count, 7) [N/m] around the drawn ones, always the same."""
    centre = np.array([injector().values[name] for name in study.NAMES])
    return np.asarray(centre * np.random.default_rng(1).uniform(1.0 - SPREAD, 1.0 + SPREAD, (count, len(centre))))


def paper_study(seed: int = 1, generations: int = study.BEST.generations) -> Study:
    """The paper's search: seven stiffnesses, 50 members, 70 generations, one pressure; data are SYNTHETIC.

    The seed is the search's; the synthetic measurement is always the same.
    """
    settings = study.BEST._replace(generations=generations).settings
    return Study("paper", injector(), _data(), study.space(injector()), Method(settings), seed, TIME_STEP)


@functools.cache
def _data() -> tuple[RateData, ...]:
    return measure(Bench(load_truth(INJECTOR), injector(), TIME_STEP), 1)[:1]
