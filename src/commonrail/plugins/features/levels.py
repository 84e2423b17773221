"""Thresholds and averaging that are applied to one trace."""

from __future__ import annotations

import math
from typing import NamedTuple

from commonrail.base.errors import ConfigurationError
from commonrail.plugins.features.rate_trace import RateTrace, spread
from commonrail.plugins.features.settings import FeatureSettings

LONGEST = 25e-6  # automatic averaging of a noisy trace, at most [s]
QUIET = 2e-4  # target standard deviation of the averaged rate when a trace is divided, as a share of the largest rate
CLEAR = 4.0  # standard deviations of the averaged rate that must fit into the hysteresis
SEEN = 8.0  # standard deviations above which a largest rate is not noise
LEAST = {"m3/s": 1e-7, "kg/s": 1e-4}  # largest rate below which nothing is injected: 0.1 mm³/ms, 0.1 mg/ms


class Levels(NamedTuple):
    """Rates [m³/s or kg/s] and times [s] applied to a trace, reusable for other traces."""

    threshold: float  # rate at which an injection opens and closes
    trigger: float  # rate that an injection must exceed
    release: float  # rate below which the next one can begin
    width: float  # time over which the rate is averaged
    noise: float  # standard deviation of the averaged rate
    narrowest: float = 0.0  # shortest time over which the rate is averaged about an opening or a closing


def resolve_levels(trace: RateTrace, settings: FeatureSettings) -> Levels:
    """Compute the rates and averaging for a trace; the threshold is NaN without an injection.

    `ConfigurationError` if the threshold is a rate by mass and the trace one by volume, or vice versa.
    """
    noise, wide = trace.noise, max(settings.peak_averaging, trace.interval)
    largest = float(trace.means(trace.bounds, wide).max())
    width = _averaging_width(trace, settings, noise, largest)
    calm = _noise_of_average(trace, width, noise)
    stated = settings.threshold
    if stated.unit == "1":
        seen = largest > max(SEEN * _noise_of_average(trace, wide, noise), LEAST[trace.unit])
        threshold = stated.value * largest if seen else math.nan
    elif stated.unit == trace.unit:
        threshold = stated.value
    else:
        raise ConfigurationError(
            f"The threshold {stated} is in {stated.unit}, and the rate in {trace.unit}; state it in a unit of the same "
            "kind, or as a share such as 10 %."
        )
    hysteresis, narrowest = settings.hysteresis * threshold, 0.0 if settings.averaging is None else width
    return Levels(threshold, threshold + hysteresis, threshold - hysteresis, width, calm, narrowest)


def _averaging_width(trace: RateTrace, settings: FeatureSettings, noise: float, largest: float) -> float:
    """Time over which the rate is averaged [s]."""
    interval = trace.interval
    if settings.averaging is not None:
        return max(settings.averaging, interval)
    samples = (noise / (QUIET * largest)) ** 2 if largest > 0.0 else 1.0
    return interval * max(1, min(math.ceil(samples - 1e-9), int(LONGEST / interval + 1e-9)))


def _noise_of_average(trace: RateTrace, width: float, noise: float) -> float:
    """Standard deviation of the averaged rate: white noise, or more if the samples at rest show it."""
    white = noise / math.sqrt(max(width / trace.interval, 1.0))
    count = len(trace.at_rest)
    middles = trace.bounds[: count + 1]
    inside = middles[(middles >= middles[0] + 0.5 * width) & (middles <= middles[-1] - 0.5 * width)]
    if len(inside) * trace.interval < 10.0 * width:
        return white
    return max(white, spread(trace.means(inside, width)))
