"""Misfit between an injector and measured data, for whole populations at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from commonrail.calibration.study import QuantityData, RateData, Role
from commonrail.engine.lanes import Misfit, Precision
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.plan import Prepared, prepare, reference_densities
from commonrail.engine.sampling import sampled_rates
from commonrail.engine.simulate import simulate_batch
from commonrail.engine.solution import Batch
from commonrail.engine.status import OK, Status, which_failed
from commonrail.engine.time_step import check_step
from commonrail.errors import ConfigurationError
from commonrail.injector.definition import Injector

Floats = NDArray[np.float64]

MM3_PER_MS = 1e6  # of 1 m³/s: the unit of the paper's J


class Scores(NamedTuple):
    """What became of candidates.

    Attributes
    ----------
    costs : (n,)
        Objective, +inf where a simulation failed.
    statuses : (n,) int8
        Value of `Status`: of the first operating point that failed, OK if none did.
    simulations : int
        Single injections that it took.
    """

    costs: Floats
    statuses: NDArray[np.int8]
    simulations: int


def curve_j(rate: Floats, data: RateData) -> float:
    """J of an injection curve: Σ |rate − measured rate| over its samples [mm³/ms]; NaN for a failed simulation."""
    return float(np.sum(np.abs(rate - data.rate)) * MM3_PER_MS)


def quantity_residuals(data: QuantityData, quantity: Floats) -> Floats:
    """(Q − Q_measured)/(absolute + relative · Q_measured), (candidates, points)."""
    return np.asarray((quantity - data.quantity) / (data.absolute + data.relative * data.quantity))


def soft_l1(residuals: Floats) -> Floats:
    """Sum of 2 (sqrt(1 + r²) − 1): r² for small residuals, 2 |r| for large ones, (candidates,)."""
    return np.asarray(np.sum(2.0 * (np.sqrt(1.0 + residuals**2) - 1.0), axis=1))


class Objective:
    """Objective of a set of data: Σ weight · J over the data sets.

    J of an injection curve is the paper's, Σ |rate − measured rate| in mm³/ms over its samples (Sec. 4). J of a
    quantity map is the soft-L1 sum of (Q − Q_measured)/(absolute + relative · Q_measured).

    Parameters
    ----------
    injector : Injector
        Gives the values that do not vary.
    names : sequence of str
        Parameters that vary.
    data : sequence of RateData or QuantityData
    time_step : float
        [s].
    threads : int or None
    precision : Precision
        Of the costs; the residuals for least squares, which are differences of small changes, are f64 always.
    """

    def __init__(
        self,
        injector: Injector,
        names: Sequence[str],
        data: Sequence[RateData | QuantityData],
        time_step: float,
        threads: int | None = None,
        precision: Precision = Precision.F64,
    ) -> None:
        self.injector, self.names, self.time_step, self.threads = injector, tuple(names), time_step, threads
        self.precision = precision
        self.curves = [d for d in data if isinstance(d, RateData)]
        self.maps = [d for d in data if isinstance(d, QuantityData)]
        self._misfit = _misfit(self.curves, time_step) if self.curves else None
        self._weights = np.array([d.weight for d in self.curves])
        self._points = [d.point for d in self.curves]
        self._prepared: dict[int, Prepared] = {}  # by the identity of their points, which they hold

    def __getstate__(self) -> dict[str, Any]:
        """For workers, which prepare their simulations themselves."""
        return self.__dict__ | {"_prepared": {}}

    def costs(self, values: Floats) -> Scores:
        """Objective of candidates (n, names), SI."""
        total = np.zeros(len(values))
        statuses = np.zeros(len(values), np.int8)
        simulations = 0
        if self._misfit is not None:
            batch = self._curves(values)
            total += np.sum(batch.absolute_error * MM3_PER_MS * self._weights, axis=1)
            _note_failures(statuses, batch.status, which_failed(batch.status))
            simulations += len(values) * len(self.curves)
        for data in self.maps:
            batch = self._map(data, values, self.precision)
            total += data.weight * soft_l1(quantity_residuals(data, _quantities(batch, data.mass_density)))
            _note_failures(statuses, batch.status, batch.status != OK)
            simulations += len(values) * len(data.points)
        finite = np.isfinite(total)
        if not finite.all():
            statuses[~finite & (statuses == OK)] = Status.NOT_FINITE
            total = np.where(finite, total, np.inf)
        return Scores(total, statuses, simulations)

    def curve_costs(self, values: Floats) -> Floats:
        """J of each injection curve, (n, curves) [mm³/ms]; NaN for a failed simulation."""
        return self._curves(values).absolute_error * MM3_PER_MS

    def quantities(self, data: QuantityData, values: Floats) -> Floats:
        """Injected quantities (n, points) [m³]; NaN for a failed simulation or a needle that never closes."""
        return _quantities(self._map(data, values, Precision.F64), data.mass_density)

    def _curves(self, values: Floats) -> Batch:
        return self._batch(self._points, values, self.precision, self._misfit)

    def _map(self, data: QuantityData, values: Floats, precision: Precision) -> Batch:
        return self._batch(data.points, values, precision)

    def _batch(
        self, points: Sequence[OperatingPoint], values: Floats, precision: Precision, misfit: Misfit | None = None
    ) -> Batch:
        if id(points) not in self._prepared:
            check_step(self.time_step)
            self._prepared[id(points)] = prepare(self.injector, points, self.time_step)
        return simulate_batch(
            self.injector,
            points,
            self.names,
            values,
            time_step=self.time_step,
            threads=self.threads,
            misfit=misfit,
            precision=precision,
            prepared=self._prepared[id(points)],
        )

    def rates(self, data: RateData, values: Floats) -> Floats:
        """Simulated samples of one injection curve (n, samples) [m³/s]."""
        mass = sampled_rates(self.injector, data.point, data.bounds, self.names, values, self.time_step)
        own = reference_densities(self.injector, [data.point], self.names, values)
        return mass / _density(data.mass_density, own)

    def residuals(self, values: Floats) -> Floats:
        """Residuals for least squares (n, all samples and points), each set scaled by the root of its weight."""
        blocks = [np.sqrt(d.weight) * (self.rates(d, values) - d.rate) * MM3_PER_MS for d in self.curves]
        blocks += [np.sqrt(d.weight) * quantity_residuals(d, self.quantities(d, values)) for d in self.maps]
        return np.concatenate(blocks, axis=1)


def _quantities(batch: Batch, mass_density: ArrayLike) -> Floats:
    volume = batch.injected_mass / _density(mass_density, batch.reference_density)
    return np.where(batch.status == OK, volume, np.nan)


def _density(of_data: ArrayLike, own: Floats) -> Floats:
    """Density that makes a volume of a simulated mass: that of data measured by mass, or the candidate's own."""
    return np.where(np.isnan(of_data), own, of_data)


def _note_failures(statuses: NDArray[np.int8], found: NDArray[np.integer[Any]], failed: NDArray[np.bool_]) -> None:
    """Put the first status (n, points) that failed where there is none yet (n,)."""
    if failed.any():
        first = found[np.arange(len(found)), np.argmax(failed, axis=1)]
        np.copyto(statuses, first.astype(np.int8), where=failed.any(axis=1) & (statuses == OK))


def of_role(data: Sequence[RateData | QuantityData], role: Role) -> list[RateData | QuantityData]:
    """Data sets of one role."""
    return [d for d in data if d.role is role]


def dead_times(injector: Injector, data: QuantityData, time_step: float, threads: int | None = None) -> Floats:
    """Energising time at which each dead-time row's quantity is reached [s], by interpolation; (rows,)."""
    rows = np.flatnonzero(data.dead_time)
    found = np.full(len(rows), np.nan)
    mass_density = np.broadcast_to(data.mass_density, data.quantity.shape)
    for i, row in enumerate(rows):
        point = data.points[row]
        grid = np.linspace(120e-6, 480e-6, 37)
        points = [_energised(point, float(t)) for t in grid]
        batch = simulate_batch(injector, points, time_step=time_step, threads=threads)
        quantity = _quantities(batch, mass_density[row])[0]
        above = np.flatnonzero(quantity > data.quantity[row])
        if len(above) and above[0] > 0:
            k = int(above[0])
            share = (data.quantity[row] - quantity[k - 1]) / (quantity[k] - quantity[k - 1])
            found[i] = grid[k - 1] + share * (grid[k] - grid[k - 1])
    return found


def _energised(point: OperatingPoint, duration: float) -> OperatingPoint:
    return OperatingPoint(
        point.rail_pressure, duration, point.cylinder_pressure, point.return_pressure, start=point.start
    )


def _misfit(curves: Sequence[RateData], dt: float) -> Misfit:
    most = max(len(d.bounds) for d in curves)
    bounds, target, weight = (np.zeros((len(curves), most)) for _ in range(3))
    for i, data in enumerate(curves):
        n = len(data.bounds)
        first, last = data.point.start - 0.5 * dt, data.point.start + data.point.duration + 0.5 * dt
        if n != len(data.rate) + 1 or not first <= data.bounds[0] < data.bounds[-1] <= last:
            raise ConfigurationError(
                f"{data.name}: the samples' bounds must lie inside the simulated time and be one more than the samples."
            )
        bounds[i, :n] = (data.bounds - data.point.start) / dt
        target[i, 1:n] = data.rate
        weight[i, 1:n] = 1.0
    density = np.array([[d.mass_density for d in curves]])
    return Misfit(np.array([len(d.bounds) for d in curves]), bounds, target, weight, density)
