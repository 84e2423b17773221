"""Adjust maps for a control unit: smooth, make monotone, round, and state the quantity error of each step."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from commonrail.base.arrays import Bools, Floats
from commonrail.base.errors import ConfigurationError
from commonrail.plugins.maps.axes import MapAxes
from commonrail.plugins.maps.choices import CellState
from commonrail.plugins.maps.inverse import Inverse, Simulate

if TYPE_CHECKING:
    from scipy.sparse import csc_array

STRENGTHS = (-12.0, 7.0)  # decimal logarithm of the weakest and the strongest smoothing
HALVINGS = 14  # bisection steps over this range: to a thousandth of a decade
SLOPE_STEP = 5e-6  # half of the time over which the slope of the quantity is computed [s]


class Adjustment(NamedTuple):
    """Steps that adjust a map for a control unit, in this order.

    `smooth`: quantity error that smoothing may cost, root mean square over the cells [m³]; `monotone`: quantities do
    not fall with the energising time, times do not fall with the quantity; `time_resolution` [s] and
    `quantity_resolution` [m³] of the control unit. None omits a step.
    """

    smooth: float | None = None
    monotone: bool = False
    time_resolution: float | None = None
    quantity_resolution: float | None = None

    def check(self) -> Adjustment:
        """Return the adjustment; `ConfigurationError` for a number that is not greater than zero."""
        for name in ("smooth", "time_resolution", "quantity_resolution"):
            value = getattr(self, name)
            if value is not None and not value > 0.0:
                what = name.replace("_", " ").replace("smooth", "quantity error of smoothing")
                raise ConfigurationError(f"The {what} must be greater than zero.")
        return self


UNADJUSTED = Adjustment()


class Cost(NamedTuple):
    """Quantities after a step minus those before it, over the cells of a map.

    `step` is "smooth", "monotone" or "resolution"; `inverse` is true for the map of energising times, whose quantities
    are simulated before and after. `rms` is the root mean square and `largest` the largest difference [m³], found at
    `rail_pressure` [Pa] and `at`: an energising time [s], or for the inverse map a quantity [m³].
    """

    step: str
    inverse: bool
    rms: float
    largest: float
    rail_pressure: float
    at: float

    @property
    def sentence(self) -> str:
        """Step, its error, and the cell with the largest error."""
        what, at = "quantities", f"{self.at * 1e6:.4g} us"
        if self.inverse:
            what, at = "energising times", f"{self.at * 1e9:.4g} mm3"
        if self.largest == 0.0:
            return f"{what} {WORDS[self.step]}: no quantity error"
        size = f"quantity error {self.rms * 1e9:.3g} mm3 rms, largest {self.largest * 1e9:+.3g} mm3"
        return f"{what} {WORDS[self.step]}: {size} at {self.rail_pressure * 1e-6:.4g} MPa and {at}"


WORDS = {"smooth": "smoothed", "monotone": "made monotone", "resolution": "rounded"}


class Curves(NamedTuple):
    """Quantities (pressures, times) [m³] at energising times (times,) [s] from 0 on, finer than the axis of a map."""

    time: Floats
    volume: Floats


def adjust(
    adjustment: Adjustment, axes: MapAxes, curves: Curves, inverse: Inverse, simulate: Simulate
) -> tuple[Curves, Inverse, tuple[Cost, ...]]:
    """Adjust quantities and energising times; return both with the errors of the steps.

    `simulate` takes the indices of pressures (n,) and energising times (n,) [s].
    """
    costs = list[Cost]()
    cells, shut = np.isin(curves.time, axes.energising_time), curves.volume == 0.0
    plain, times = curves.volume, inverse.energising_time

    def clip_quantities(volume: Floats) -> Floats:
        return np.where(shut, 0.0, np.maximum(volume, 0.0))

    def smooth_quantities(largest: float) -> Floats:
        grid, even = (axes.rail_pressure, curves.time), np.ones(plain.shape)
        return smooth(plain, grid, even, clip_quantities, lambda smoothed: _rms((smoothed - plain)[:, cells]), largest)

    for step, volume in _steps(adjustment, plain, smooth_quantities, adjustment.quantity_resolution, np.array(False)):
        costs.append(_cost(step, False, axes, (volume - curves.volume)[:, cells]))
        curves = curves._replace(volume=volume)
    reached = np.isin(inverse.state, (CellState.REACHED, CellState.SEVERAL))
    jump = inverse.state == CellState.JUMP  # a shorter time delivers a much smaller quantity
    searched, before = reached | jump, inverse.delivered

    def at(time: Floats) -> Inverse:
        response = simulate(np.nonzero(searched)[0], time[searched])
        delivered, lift = np.full((2, *time.shape), np.nan)
        delivered[searched], lift[searched] = response.volume, response.lift
        return inverse._replace(energising_time=time, delivered=np.where(searched, delivered, before), lift=lift)

    def smooth_times(largest: float) -> Floats:
        grid, weight = (axes.rail_pressure, axes.quantity), np.where(reached, _slopes(curves, times), 0.0) ** 2

        def cost(candidate: Floats) -> float:
            return _rms((at(candidate).delivered - before)[reached])

        return smooth(times, grid, weight, lambda smoothed: np.where(reached, smoothed, times), cost, largest)

    for step, time in _steps(adjustment, times, smooth_times, adjustment.time_resolution, jump):
        after = at(time)
        costs.append(_cost(step, True, axes, np.where(searched, after.delivered - inverse.delivered, np.nan)))
        inverse = after
    return curves, inverse, tuple(costs)


def _steps(
    adjustment: Adjustment,
    values: Floats,
    smooth_values: Callable[[float], Floats],
    resolution: float | None,
    up: Bools,
) -> Iterator[tuple[str, Floats]]:
    """Yield the values after each step; values in the mask `up` are never rounded down."""
    if adjustment.smooth is not None:
        values = smooth_values(adjustment.smooth)
        yield "smooth", values
    if adjustment.monotone:
        values = monotone(values)
        yield "monotone", values
    if resolution is not None:
        steps = values / resolution
        yield "resolution", np.where(up, np.ceil(steps - 1e-9), np.round(steps)) * resolution


def _slopes(curves: Curves, time: Floats) -> Floats:
    """Slopes of the quantity [m³/s] at energising times (pressures, n) [s], at least a thousandth of the largest."""
    steps = np.array([-SLOPE_STEP, SLOPE_STEP])
    ends = [
        np.interp(np.nan_to_num(row)[:, None] + steps, curves.time, np.nan_to_num(volume))
        for row, volume in zip(time, curves.volume, strict=True)
    ]
    slope = np.diff(np.array(ends), axis=2)[:, :, 0] / (2.0 * SLOPE_STEP)
    return np.asarray(np.maximum(slope, 1e-3 * slope.max(initial=0.0)))


def monotone(values: Floats) -> Floats:
    """Return non-decreasing rows nearest to `values` (rows, n) by least squares; NaN stays.

    Neighbours that fall are pooled to their mean (isotonic regression, Barlow et al. 1972; Busing 2022).
    """
    from scipy.optimize import isotonic_regression  # slow to import

    rows = values.copy()
    for row in rows:
        sound = np.isfinite(row)
        if sound.any():
            row[sound] = isotonic_regression(row[sound]).x
    return rows


def smooth(
    values: Floats,
    axes: tuple[Floats, Floats],
    weight: Floats,
    limit: Callable[[Floats], Floats],
    cost: Callable[[Floats], float],
    largest: float,
) -> Floats:
    """Return the smoothest values (n, m) over two axes whose cost, after applying `limit`, is at most `largest`.

    Least squares with a penalty on second divided differences along both axes (Whittaker 1923; Eilers 2003), which
    leaves planes unchanged. The penalty is as strong as the cost allows (Morozov 1966). Values that are NaN or have
    zero weight follow from the others.
    """
    from scipy.sparse import csc_array, diags_array, eye_array, kron  # slow to import
    from scipy.sparse.linalg import spsolve

    sound = np.isfinite(values) & (weight > 0.0)
    if not sound.any():
        return values
    scaled = np.where(sound, weight / weight[sound].mean(), 0.0)
    target = scaled * np.where(sound, values, 0.0)
    identity = [eye_array(len(axis)) for axis in axes]
    penalty = kron(_bending(axes[0]), identity[1]) + kron(identity[0], _bending(axes[1]))
    data = diags_array(scaled.ravel() + 1e-12)  # makes every value determined

    def solve(strength: float) -> Floats:
        matrix = csc_array(data + 10.0**strength * penalty)
        return limit(spsolve(matrix, target.ravel()).reshape(values.shape))

    weak, strong = STRENGTHS
    smoothest = solve(strong)
    if cost(smoothest) <= largest:
        return smoothest
    smoothest = values
    for _ in range(HALVINGS):
        middle = 0.5 * (weak + strong)
        if cost(smoothed := solve(middle)) <= largest:
            weak, smoothest = middle, smoothed
        else:
            strong = middle
    return smoothest


def _bending(axis: Floats) -> csc_array:
    """Matrix (n, n) of the sum of squared second divided differences, with the mean spacing of the axis as unit."""
    from scipy.sparse import csc_array, diags_array

    if len(axis) < 3:
        return csc_array((len(axis), len(axis)))
    h = np.diff(axis) / np.mean(np.diff(axis))
    parts = [1.0 / h[:-1], -1.0 / h[:-1] - 1.0 / h[1:], 1.0 / h[1:]]
    second = diags_array(parts, offsets=[0, 1, 2], shape=(len(axis) - 2, len(axis)))
    return csc_array(second.T @ second)


def _rms(difference: Floats) -> float:
    """Root mean square of the finite values; zero if there are no values."""
    return float(np.sqrt(np.mean(np.square(difference[np.isfinite(difference)])))) if difference.size else 0.0


def _cost(step: str, inverse: bool, axes: MapAxes, difference: Floats) -> Cost:
    """Error of a step from the differences (pressures, n) of the quantities, NaN in cells without one."""
    size = np.nan_to_num(np.abs(difference))
    i, j = np.unravel_index(int(np.argmax(size)), size.shape)
    at = (axes.quantity if inverse else axes.energising_time)[j]
    largest = float(np.nan_to_num(difference[i, j]))
    return Cost(step, inverse, _rms(difference), largest, float(axes.rail_pressure[i]), float(at))
