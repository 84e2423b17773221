"""Features of an injection that a study of many simulations looks at: quantities, instants, lift, rates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.base.arguments import known_names
from commonrail.base.arrays import Floats, Ints
from commonrail.engine.lanes import Misfit
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.solution import Batch
from commonrail.engine.status import OK, STILL_INJECTING, Status

Codes = NDArray[np.int8]

STEADY = "steady_rate"  # needs a simulation of its own
STEADY_PART = 0.2  # last part of the longest energising whose mean rate is the steady rate
SHIFT = 1e-3  # flow added to a rate to make a sum of absolute errors linear [m³/s]; some ten times any injector's

NO_EVENT = -1  # code of a feature that does not exist: the needle never opens, or never closes


class Feature(NamedTuple):
    """Feature of an injection.

    Attributes
    ----------
    name, unit, meaning : str
        SI unit.
    of : function of Batch, OperatingPoint
        Values (candidates,) at the only point of the batch; NaN where the feature does not exist.
    final : bool
        Known only when the injection has ended; the opening is known before.
    """

    name: str
    unit: str
    meaning: str
    of: Callable[[Batch, OperatingPoint], Floats]
    final: bool = True


def _first(point: OperatingPoint) -> float:
    return point.pulses[0].start if point.pulses else point.start


_ALL = (
    Feature("quantity", "m3", "injected quantity", lambda b, p: b.injected_volume[:, 0]),
    Feature("return_quantity", "m3", "return quantity", lambda b, p: b.returned_volume[:, 0]),
    Feature("opening", "s", "instant of opening", lambda b, p: b.opening[:, 0], final=False),
    Feature(
        "opening_delay",
        "s",
        "hydraulic delay: from the start of energising to opening",
        lambda b, p: b.opening[:, 0] - _first(p),
        final=False,
    ),
    Feature("closing", "s", "instant of closing", lambda b, p: b.closing[:, 0]),
    Feature(
        "closing_delay",
        "s",
        "closing delay: from the end of energising to closing",
        lambda b, p: b.closing[:, 0] - p.end_of_energising,
    ),
    Feature("duration", "s", "duration from opening to closing", lambda b, p: b.closing[:, 0] - b.opening[:, 0]),
    Feature("lift", "m", "largest needle lift", lambda b, p: b.greatest_lift[:, 0]),
    Feature(
        "mean_rate",
        "m3/s",
        "mean rate from opening to closing",
        lambda b, p: b.injected_volume[:, 0] / (b.closing[:, 0] - b.opening[:, 0]),
    ),
    Feature(
        STEADY,
        "m3/s",
        "steady rate: mean over the last fifth of the longest energising",
        lambda b, p: _unshifted(b),
        final=False,
    ),
)
FEATURES = {feature.name: feature for feature in _ALL}
DEFAULT = ("quantity", "opening_delay", "closing_delay", "duration", STEADY)


def read_features(names: Sequence[str]) -> tuple[Feature, ...]:
    """Features by name; `ConfigurationError` for one that is unknown or repeated."""
    return tuple(FEATURES[name] for name in known_names(names, FEATURES, "features", "quantity"))


def codes_of(feature: Feature, values: Floats, statuses: Ints) -> Codes:
    """Code of each value: OK where it can be used, else the status of its simulation or `NO_EVENT`.

    Parameters
    ----------
    feature : Feature
    values, statuses : (candidates,)
    """
    usable = (statuses == OK) | ((statuses == STILL_INJECTING) & (not feature.final))
    return np.where(usable, np.where(np.isfinite(values), OK, NO_EVENT), statuses).astype(np.int8)


def reason(code: int) -> str:
    """Reason in one sentence for which a value is missing."""
    if code == NO_EVENT:
        return "The needle does not open, or does not close."
    return Status(code).sentence


def steady_rates(point: OperatingPoint, dt: float) -> tuple[OperatingPoint, Misfit]:
    """Point that ends with the window of the steady rate, and the samples from which it is read.

    The engine sums |flow − target| over weighted samples. With the single target −`SHIFT` below any flow the sum is
    flow + `SHIFT`.

    Parameters
    ----------
    point : OperatingPoint
    dt : float
        Time step [s].
    """
    longest = max(point.pulses, key=lambda pulse: pulse.duration, default=None)
    end = longest.start + longest.duration if longest and longest.duration > 0.0 else point.start + 10.0 * dt
    begin = end - STEADY_PART * longest.duration if longest and longest.duration > 0.0 else point.start
    bounds = np.array([[begin - point.start, end - point.start]]) / dt
    misfit = Misfit(
        np.array([2], np.int64),
        bounds,
        np.array([[0.0, -SHIFT]]),
        np.array([[0.0, 1.0]]),
        np.full((1, 1), np.nan),
    )
    return replace(point, horizon=end - point.start + dt), misfit


def _unshifted(batch: Batch) -> Floats:
    return np.asarray(batch.absolute_error[:, 0] - SHIFT)
