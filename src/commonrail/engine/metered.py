"""A single simulation as a meter shows it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from commonrail.base.arguments import instance
from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.plan import reference_densities
from commonrail.engine.solution import Solution
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector
from commonrail.physics.meters.meter import Meter
from commonrail.physics.meters.signal import Flow, given_values, shown_quantities, shown_rates

UNEVEN = 1e-6  # relative difference between intervals that counts as rounding


@dataclass(frozen=True)
class Metered:
    """Rate and quantity of one injection as a meter shows them.

    Attributes
    ----------
    meter : Meter
    rate : (samples,)
        Means between the same bounds as the simulated rate [m³/s].
    quantity : float
        Per stroke, by gain and offset, as for a map [m³].
    """

    meter: Meter
    rate: Floats
    quantity: float

    @property
    def rate_mm3_per_ms(self) -> Floats:
        """Rate [mm³/ms]."""
        return np.asarray(self.rate * 1e6)


def metered(solution: Solution, meter: Meter, injector: Injector, point: OperatingPoint) -> Metered:
    """Show a simulated injection as a meter would.

    The flow is taken as zero before the first and after the last sample; a zero-phase filter, which sees ahead, needs a
    simulation that ends after the injection.

    Parameters
    ----------
    solution : Solution
        Of `simulate`, with samples at equal intervals.
    meter : Meter
        Its values are taken as they are, those that a study fits at their start.
    injector : Injector
        The one that was simulated; its fuel gives the density at a temperature of the meter.
    point : OperatingPoint
        The one that was simulated.

    Raises
    ------
    ConfigurationError
        If an argument is of another kind, or the intervals of the samples differ.
    """
    instance(solution, Solution, "solution")
    instance(meter, Meter, "meter")
    instance(injector, Injector, "injector")
    instance(point, OperatingPoint, "point")
    steps = np.diff(solution.time)
    if np.ptp(steps) > UNEVEN * steps[0]:
        raise ConfigurationError(
            "A meter shows samples at equal intervals, and those of the solution differ; simulate with another "
            "sample_interval."
        )
    given = given_values(meter, {}, 1)
    density = _density(solution, meter, injector, point)
    flow = Flow(solution.mass_rate[None] / density, float(solution.time[0]), float(steps.mean()))
    quantity = shown_quantities(given, np.array([[solution.injected_mass / density]]))
    return Metered(meter, shown_rates(meter, given, flow, solution.time)[0], float(quantity[0, 0]))


def _density(solution: Solution, meter: Meter, injector: Injector, point: OperatingPoint) -> float:
    """Density [kg/m³] that makes the meter's volumes."""
    if "temperature" in meter.values:
        warmth = np.array([[meter.values["temperature"]]])
        return float(reference_densities(injector, [point], [FUEL_TEMPERATURE], warmth)[0, 0])
    return meter.values.get("density", solution.reference_density)
