"""Table of features: name, unit, meaning, and how each follows from a trace and from a simulation.

To add a feature, write a function and an entry of `FEATURES`, or install a package with an entry point of the
group "features" whose object is a `Feature` of the entry point's name.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from commonrail.base import registry
from commonrail.base.arguments import shown
from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError, PluginError, nearest
from commonrail.base.hooks import note
from commonrail.engine.lanes import Misfit
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.solution import Batch
from commonrail.plugins.features.injections import Instant, TracedInjection, second_difference

STEADY_PART = 0.2  # last part of the longest energising, for the steady rate of a simulation
SHIFT = 1e-3  # flow added to a rate to make a sum of absolute errors linear [m³/s]; about ten times any injector's


class Estimate(NamedTuple):
    """Value of a feature, NaN if missing, and its standard error from the noise; None if unknown."""

    value: float
    error: float | None = None


class Feature(NamedTuple):
    """Feature of an injection.

    Attributes
    ----------
    name, meaning : str
    unit : str
        SI unit, by volume; a trace by mass has "kg" in place of "m3".
    of_trace : function of TracedInjection, optional
        `Estimate` from a measured or simulated rate; None if a rate does not show it.
    of_simulation : function of Batch and OperatingPoint, optional
        Values (candidates,) from needle motion and flows at the only point of the batch; NaN if the
        feature does not exist. None if only traces show it.
    final : bool
        Defined only after the simulated injection has ended; the opening is defined before.
    own_simulation : function of OperatingPoint and time step [s], optional
        Point and samples of an extra simulation that `of_simulation` needs.
    """

    name: str
    unit: str
    meaning: str
    of_trace: Callable[[TracedInjection], Estimate] | None = None
    of_simulation: Callable[[Batch, OperatingPoint], Floats] | None = None
    final: bool = True
    own_simulation: Callable[[OperatingPoint, float], tuple[OperatingPoint, Misfit]] | None = None


def known_features() -> dict[str, Feature]:
    """All features by name, shipped ones first; a note reports unusable ones of packages."""
    features = dict(FEATURES)
    for name in registry.find_installed("features"):
        try:
            features[name] = find_feature(name)
        except PluginError as error:
            note(str(error))
    return features


def find_feature(name: str) -> Feature:
    """Find a feature by name; `ConfigurationError` if it is unknown, `PluginError` if a package's is unusable."""
    entry = None if name in FEATURES else registry.find("features", name)
    if entry is None:
        return FEATURES[check_name(name, FEATURES)]
    feature = entry.load_as(Feature, "a Feature")
    if feature.name != name:
        raise entry.part_error(f'must be a Feature of this name, but {entry.target} is called "{feature.name}"')

    def attribute_errors(function: Callable[..., Any] | None) -> Any:
        return function and partial(_call_with_blame, entry, function)

    return feature._replace(
        of_trace=attribute_errors(feature.of_trace), of_simulation=attribute_errors(feature.of_simulation)
    )


def _call_with_blame(entry: registry.Entry, function: Callable[..., Any], *args: Any) -> Any:
    with entry.blame("fails"):
        return function(*args)


def features_of_traces() -> dict[str, Feature]:
    """Features by name that follow from an injection rate."""
    return {name: feature for name, feature in known_features().items() if feature.of_trace}


def features_of_simulations() -> dict[str, Feature]:
    """Features by name that follow from a simulation without its trace."""
    return {name: feature for name, feature in known_features().items() if feature.of_simulation}


def check_name(name: object, names: Collection[str]) -> str:
    """Return a known name of a feature; `ConfigurationError` with the nearest name if it is unknown."""
    if not isinstance(name, str) or name not in names:
        meant = nearest(name, names) if isinstance(name, str) else ""
        raise ConfigurationError(f"There is no feature {shown(name)}{meant}; the features are {', '.join(names)}.")
    return name


# From a trace: instants.


def _between(begin: Instant, end: Instant) -> Estimate:
    return Estimate(end.time - begin.time, math.hypot(begin.error, end.error))


def _delay(injection: TracedInjection, at: Instant, share: float) -> Estimate:
    """Time [s] from a share of an injection's energising to an instant; NaN without energising."""
    if injection.pulse is None:
        return Estimate(math.nan)
    return Estimate(at.time - (injection.pulse.start + share * injection.pulse.duration), at.error)


# From a trace: ramps and rates.


def _rise_time(injection: TracedInjection) -> Estimate:
    rise, begin = injection.ramps.rise, injection.ramps.begin
    return Estimate(rise, _ramp_error(injection, begin - rise, begin))


def _fall_time(injection: TracedInjection) -> Estimate:
    fall, end = injection.ramps.fall, injection.ramps.end
    return Estimate(fall, _ramp_error(injection, end, end + fall))


def _ramp_error(injection: TracedInjection, begin: float, end: float) -> float:
    """Standard error of the time [s] of a ramp between two instants [s], both defined by shares of the largest rate."""
    time = end - begin
    if not time > 0.0:
        return math.nan
    low, high = injection.settings.ramp
    rate_difference, width = (high - low) * injection.peak, max(injection.levels.width, injection.trace.interval)
    bends = (second_difference(injection.trace, at, width) / rate_difference for at in (begin, end))
    return time * math.hypot(
        math.sqrt(2.0) * injection.levels.noise / rate_difference, *bends, _peak_error(injection) / injection.peak
    )


def _peak_error(injection: TracedInjection) -> float:
    """Standard error of the largest mean over the peak averaging.

    The largest of n means with the standard deviation σ exceeds the rate by up to σ √(2 ln n), the bound of the
    expected largest of n normal values, which adds to σ.
    """
    width = max(injection.settings.peak_averaging, injection.trace.interval)
    count = max((injection.ramps.end - injection.ramps.begin) / width, 1.0)
    return injection.levels.noise * math.sqrt(injection.levels.width / width * (1.0 + 2.0 * math.log(count)))


# From a trace: quantities, with the errors of sums of white noise.


def _quantity(injection: TracedInjection) -> Estimate:
    trace, (begin, end) = injection.trace, injection.window
    length, grown = end - begin, 1.0
    if injection.settings.zero_at_rest:  # the error of the zero, a mean of few samples, counts over the whole window
        rest = trace.interval * len(trace.at_rest)
        shared = max(0.0, float(trace.bounds[len(trace.at_rest)]) - begin)  # at rest and within the window
        grown = max(1.0 + (length - 2.0 * shared) / rest, 0.0)
    return Estimate(trace.quantity(begin, end), trace.noise * math.sqrt(trace.interval * length * grown))


def _dribble(injection: TracedInjection) -> Estimate:
    closing = injection.at.closing.time
    return Estimate(injection.trace.quantity(closing, injection.window[1]) if math.isfinite(closing) else math.nan)


# From a simulation.


def steady_samples(point: OperatingPoint, dt: float) -> tuple[OperatingPoint, Misfit]:
    """Return a point that ends with the window of the steady rate, and the sample that gives it.

    The engine sums |flow − target| over weighted samples. With the single target −`SHIFT` below any flow the sum is
    flow + `SHIFT`. The time step `dt` is in [s].
    """
    longest = max(point.pulses, key=lambda pulse: pulse.duration, default=None)
    end = longest.start + longest.duration if longest and longest.duration > 0.0 else point.start + 10.0 * dt
    begin = end - STEADY_PART * longest.duration if longest and longest.duration > 0.0 else point.start
    bounds = np.array([[begin - point.start, end - point.start]]) / dt
    target, weight = np.array([[0.0, -SHIFT]]), np.array([[0.0, 1.0]])
    misfit = Misfit(np.array([2], np.int64), bounds, target, weight, np.full((1, 1), np.nan))
    return replace(point, horizon=end - point.start + dt), misfit


# `i`: TracedInjection; `b`, `p`: Batch and its OperatingPoint.
FEATURES: Mapping[str, Feature] = {
    feature.name: feature
    for feature in (
        Feature(
            "opening",
            "s",
            "instant of opening; in a trace, when the rate rises above the threshold",
            lambda i: Estimate(*i.at.opening),
            lambda b, p: b.opening[:, 0],
            final=False,
        ),
        Feature(
            "closing",
            "s",
            "instant of closing; in a trace, when the rate falls below the threshold",
            lambda i: Estimate(*i.at.closing),
            lambda b, p: b.closing[:, 0],
        ),
        Feature(
            "opening_delay",
            "s",
            "hydraulic delay: from the start of energising to opening",
            lambda i: _delay(i, i.at.opening, 0.0),
            lambda b, p: b.opening[:, 0] - (p.pulses[0].start if p.pulses else p.start),
            final=False,
        ),
        Feature(
            "closing_delay",
            "s",
            "closing delay: from the end of energising to closing",
            lambda i: _delay(i, i.at.closing, 1.0),
            lambda b, p: b.closing[:, 0] - p.end_of_energising,
        ),
        Feature(
            "duration",
            "s",
            "from opening to closing",
            lambda i: _between(i.at.opening, i.at.closing),
            lambda b, p: b.closing[:, 0] - b.opening[:, 0],
        ),
        Feature(
            "separation",
            "s",
            "from the closing of the previous injection to opening",
            lambda i: _between(i.before, i.at.opening),
        ),
        Feature("rise_time", "s", "opening ramp, between two shares of the largest rate", _rise_time),
        Feature("fall_time", "s", "closing ramp, between the same shares", _fall_time),
        Feature(
            "steady_rate",
            "m3/s",
            "mean of the middle half of the plateau; in a simulation, of the last fifth of the longest energising",
            lambda i: Estimate(i.steady),
            lambda b, p: b.absolute_error[:, 0] - SHIFT,
            final=False,
            own_simulation=steady_samples,
        ),
        Feature("peak_rate", "m3/s", "largest mean over the peak averaging", lambda i: Estimate(i.peak)),
        Feature(
            "mean_rate",
            "m3/s",
            "mean rate from opening to closing",
            None,
            lambda b, p: b.injected_volume[:, 0] / (b.closing[:, 0] - b.opening[:, 0]),
        ),
        Feature("quantity", "m3", "injected quantity", _quantity, lambda b, p: b.injected_volume[:, 0]),
        Feature(
            "total_quantity",
            "m3",
            "quantity with what reopenings after the same energising add",
            lambda i: Estimate(sum(i.trace.quantity(*w) for w in i.windows) if i.windows else math.nan),
        ),
        Feature("dribble", "m3", "quantity after closing", _dribble),
        Feature("return_quantity", "m3", "return quantity", None, lambda b, p: b.returned_volume[:, 0]),
        Feature("lift", "m", "largest needle lift", None, lambda b, p: b.greatest_lift[:, 0]),
    )
}
