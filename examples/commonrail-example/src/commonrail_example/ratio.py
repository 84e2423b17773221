"""Feature of an injection: its quantity over the energising time, of a rate of injection and of a simulation."""

import math

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.solution import Batch
from commonrail.plugins.features.injections import TracedInjection
from commonrail.plugins.features.table import Estimate, Feature


def _of_trace(injection: TracedInjection) -> Estimate:
    quantity = injection.trace.quantity(*injection.window)
    return Estimate(math.nan if injection.pulse is None else quantity / injection.pulse.duration)


def _of_simulation(batch: Batch, point: OperatingPoint) -> Floats:
    return np.asarray(batch.injected_volume[:, 0] / sum(pulse.duration for pulse in point.pulses))


FEATURE = Feature("energised_rate", "m3/s", "quantity over the energising time", _of_trace, _of_simulation)
