"""Candidates of an injector, simulated at the operating points of data sets and seen through their meters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.choices import Precision
from commonrail.engine.lanes import Misfit
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.plan import Prepared, prepare, reference_densities
from commonrail.engine.simulate import sampled_rates, simulate_batch
from commonrail.engine.solution import Batch
from commonrail.engine.time_step import check_step
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector
from commonrail.physics.meters import Flow, Meter, given_values, is_of_meter, parts_of

ITSELF = np.empty((1, 0))  # values of the one candidate that is the injector as it is
SHARE = 1_000_000  # steps of candidates that are kept at a time: some 40 MB


class Candidates(NamedTuple):
    """Simulator and values (candidates, names) of candidates: what their meters' quantities are read from."""

    simulator: Simulator
    values: Floats

    def meter_values(self, meter: Meter) -> dict[str, Floats]:
        """Values of a meter's quantities, (candidates,) each."""
        columns = {
            parts_of(name)[1]: self.values[:, i] for i, name in enumerate(self.simulator.names) if meter.owns(name)
        }
        return given_values(meter, columns, len(self.values))

    def densities(self, points: Sequence[OperatingPoint], meter_values: Mapping[str, Floats] | None = None) -> Floats:
        """Densities [kg/m³] that make volumes of masses, (1 or candidates, points).

        `meter_values`: quantities of a meter with a density or a temperature of its own.
        """
        injector = self.simulator.injector
        if meter_values and "density" in meter_values:
            return np.repeat(meter_values["density"][:, None], len(points), axis=1)
        if meter_values and "temperature" in meter_values:
            return reference_densities(injector, points, [FUEL_TEMPERATURE], meter_values["temperature"][:, None])
        names, values = self.simulator.of_injector(self.values)
        if FUEL_TEMPERATURE not in names:
            return self.simulator.prepared(points).densities
        return reference_densities(injector, points, names, values)


class Simulator:
    """An injector, the parameters of it that vary, and how it is simulated.

    `injector` gives the values that do not vary; `names` are the parameters that do, of the injector and of meters,
    none for the injector as it is. `time_step` in [s]. `threads`: all usable processors by default. `precision`: of
    batches that ask for none themselves. `same_bits`: simulate to the same bits on every x86-64 processor, see
    `simulate_batch`.
    """

    def __init__(
        self,
        injector: Injector,
        names: Sequence[str],
        time_step: float,
        threads: int | None = None,
        *,
        precision: Precision = Precision.F64,
        same_bits: bool = False,
    ) -> None:
        self.injector, self.names, self.time_step, self.threads = injector, tuple(names), time_step, threads
        self.precision, self.same_bits = precision, same_bits
        self._own = [i for i, name in enumerate(self.names) if not is_of_meter(name)]
        # the point, the same with a later end, and the bounds of its steps, by its identity and the time beyond it
        self._longer: dict[tuple[int, float], tuple[OperatingPoint, tuple[OperatingPoint], Floats]] = {}
        self._prepared: dict[int, Prepared] = {}  # by the identity of their points, which they hold

    def __getstate__(self) -> dict[str, Any]:
        """For workers, which prepare their simulations themselves."""
        return self.__dict__ | {"_prepared": {}, "_longer": {}}

    def of_injector(self, values: Floats) -> tuple[tuple[str, ...], Floats]:
        """Names and values (candidates, names) of the injector's own parameters."""
        if len(self._own) == len(self.names):
            return self.names, values
        return tuple(self.names[i] for i in self._own), values[:, self._own]

    def varies(self, meter: Meter) -> bool:
        """True if a quantity of the meter is among the parameters that vary."""
        return any(meter.owns(name) for name in self.names)

    def batch(
        self,
        points: Sequence[OperatingPoint],
        values: Floats,
        precision: Precision | None = None,
        misfit: Misfit | None = None,
        *,
        to_horizon: bool = False,
    ) -> Batch:
        """Figures of candidates at operating points.

        What the points share with other candidates is prepared once for the same sequence. The values are
        (candidates, names) [SI]; samples of `misfit` are compared with, and `to_horizon` is that of `Term`.
        """
        return simulate_batch(
            self.injector,
            points,
            *self.of_injector(values),
            time_step=self.time_step,
            threads=self.threads,
            misfit=misfit,
            stop_when_closed=not to_horizon,
            precision=precision or self.precision,
            prepared=self.prepared(points),
            same_bits=self.same_bits,
        )

    def prepared(self, points: Sequence[OperatingPoint]) -> Prepared:
        """Injector at operating points, made once for the same sequence."""
        if id(points) not in self._prepared:
            check_step(self.time_step)
            self._prepared[id(points)] = prepare(self.injector, points, self.time_step)
        return self._prepared[id(points)]

    def once(self, points: Sequence[OperatingPoint]) -> Batch:
        """Figures of the injector as it is at points that are not asked for again, (1, points)."""
        return simulate_batch(
            self.injector, points, time_step=self.time_step, threads=self.threads, same_bits=self.same_bits
        )

    def flow(self, point: OperatingPoint, values: Floats, ahead: float = 0.0) -> Flow:
        """Mean mass flow of candidates in each time step [kg/s].

        Candidates that differ in quantities of meters alone are simulated once.

        `values` (candidates, names) in [SI]. `ahead`: time beyond the point's horizon [s].
        """
        if (id(point), ahead) not in self._longer:
            steps = max(round((point.duration + ahead) / self.time_step), 1)
            extended = replace(point, horizon=steps * self.time_step) if ahead > 0.0 else point
            bounds = point.start + self.time_step * np.arange(steps + 1, dtype=np.float64)
            self._longer[id(point), ahead] = point, (extended,), bounds
        _, longer, times = self._longer[id(point), ahead]
        names, varied = self.of_injector(values)
        distinct, which = varied[:1], np.zeros(len(varied), int)
        if names:
            distinct, which = np.unique(varied, axis=0, return_inverse=True)
        rates = np.empty((len(distinct), len(times) - 1))
        share = max(SHARE // len(times), 1)
        for first in range(0, len(distinct), share):
            rows = slice(first, first + share)
            inputs = self.injector, longer[0], times, names, distinct[rows], self.time_step
            rates[rows] = sampled_rates(
                *inputs, threads=self.threads, prepared=self.prepared(longer), same_bits=self.same_bits
            )
        return Flow(rates[which.reshape(-1)], point.start, self.time_step)
