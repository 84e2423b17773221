"""Thresholds and averaging for features, as stated and as applied to one trace."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from commonrail.base.arguments import Limits, Quantity, amount, flag, fraction, number, sequence, settle
from commonrail.base.errors import ConfigurationError, InputError
from commonrail.base.units import parse, to_text
from commonrail.plugins.features.rate_trace import RateTrace, spread

AVERAGINGS = Limits(1e-9, 1e-3, (1e-6, 1e-3), ("us",))  # [s]
TIMES = Limits(0.0, 0.1, (1e-6, 0.1), ("us", "ms"))  # [s]
LONGEST = 25e-6  # automatic averaging of a noisy trace, at most [s]
QUIET = 2e-4  # target standard deviation of the averaged rate when a trace is divided, as a share of the largest rate
CLEAR = 4.0  # standard deviations of the averaged rate that must fit into the hysteresis
SEEN = 8.0  # standard deviations above which a largest rate is not noise
LEAST = {"m3/s": 1e-7, "kg/s": 1e-4}  # largest rate below which nothing is injected: 0.1 mm³/ms, 0.1 mg/ms


class Threshold(NamedTuple):
    """Threshold of the rate: a share of the largest rate (unit "1"), or a rate [m³/s or kg/s]."""

    value: float
    unit: str = "1"

    def __str__(self) -> str:
        return f"{100.0 * self.value:g} %" if self.unit == "1" else to_text(self.value, self.unit)


class Levels(NamedTuple):
    """Rates [m³/s or kg/s] and times [s] applied to a trace, reusable for other traces."""

    threshold: float  # rate at which an injection opens and closes
    trigger: float  # rate that an injection must exceed
    release: float  # rate below which the next one can begin
    width: float  # time over which the rate is averaged
    noise: float  # standard deviation of the averaged rate
    narrowest: float = 0.0  # shortest time over which the rate is averaged about an opening or a closing


@dataclass(frozen=True)
class FeatureSettings:
    """Thresholds and averaging of features.

    Attributes
    ----------
    threshold : Threshold, float or str
        Rate at which an injection opens and closes: a share of the largest rate of the trace, 0.1 or "10 %", or a
        rate, "2 mm3/ms" or "2 mg/ms".
    hysteresis : float
        Share of the threshold by which the rate must rise above it for an injection to count, and fall below it for
        the next to begin.
    split : float
        Share of the smaller neighbouring peak below which the rate must fall to divide injections.
    ramp : (float, float)
        Shares of the largest rate between which ramps are timed.
    averaging : float or str, optional
        Time over which the rate is averaged [s]; by default one sample, with noise up to 25 us, near
        openings and closings at most twice the time to the foot or the top of the ramp.
    peak_averaging : float or str
        Averaging time of the largest rate [s].
    tail : float or str
        Time before opening and after closing that counts for quantity and dribble [s], at most half the distance to
        the next injection.
    least_delay : float or str
        Shortest time from the start of an energising to its injection [s].
    zero_at_rest : bool
        Subtract the mean rate before the first energising.

    Raises
    ------
    ConfigurationError
        If a value cannot be read or is out of range.
    """

    threshold: Threshold | Quantity = 0.1
    hysteresis: float = 0.5
    split: float = 0.5
    ramp: tuple[float, float] = (0.2, 0.8)
    averaging: Quantity | None = None
    peak_averaging: Quantity = 50e-6
    tail: Quantity = 500e-6
    least_delay: Quantity = 100e-6
    zero_at_rest: bool = False

    def __post_init__(self) -> None:
        if len(sequence(self.ramp, "ramp", "(0.2, 0.8)")) != 2:
            raise ConfigurationError("The ramp must be two shares of the largest rate, such as (0.2, 0.8).")
        low, high = (fraction(share, "ramp") for share in self.ramp)
        if not low < high:
            raise ConfigurationError(f"The shares of the ramp must increase, not {low:g} and {high:g}.")
        averaging = None if self.averaging is None else amount(self.averaging, "s", "averaging", AVERAGINGS)
        settle(
            self,
            threshold=_threshold(self.threshold),
            hysteresis=fraction(self.hysteresis, "hysteresis"),
            split=fraction(self.split, "split"),
            ramp=(low, high),
            averaging=averaging,
            peak_averaging=amount(self.peak_averaging, "s", "peak_averaging", AVERAGINGS),
            tail=amount(self.tail, "s", "tail", TIMES),
            least_delay=amount(self.least_delay, "s", "least_delay", TIMES),
            zero_at_rest=flag(self.zero_at_rest, "zero_at_rest"),
        )


def resolve_levels(trace: RateTrace, settings: FeatureSettings) -> Levels:
    """Compute the rates and averaging for a trace; the threshold is NaN without an injection.

    `ConfigurationError` if the threshold is a rate by mass and the trace one by volume, or vice versa.
    """
    noise, wide = trace.noise, max(float(settings.peak_averaging), trace.interval)
    largest = float(trace.means(trace.bounds, wide).max())
    width = _averaging_width(trace, settings, noise, largest)
    calm = _noise_of_average(trace, width, noise)
    stated = settings.threshold
    assert isinstance(stated, Threshold)
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
    hysteresis, narrowest = float(settings.hysteresis) * threshold, 0.0 if settings.averaging is None else width
    return Levels(threshold, threshold + hysteresis, threshold - hysteresis, width, calm, narrowest)


def _averaging_width(trace: RateTrace, settings: FeatureSettings, noise: float, largest: float) -> float:
    """Time over which the rate is averaged [s]."""
    interval = trace.interval
    if settings.averaging is not None:
        return max(float(settings.averaging), interval)
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


def _threshold(threshold: object) -> Threshold:
    if isinstance(threshold, Threshold):
        value, unit = threshold
    elif isinstance(threshold, str):
        value, unit = _parse_threshold(threshold)
    else:
        value, unit = number(threshold, "1", "threshold"), "1"
    if not 0.0 < value < (1.0 if unit == "1" else math.inf):
        read = f'"{threshold}"' if isinstance(threshold, str) else f"{value:g} {unit.removesuffix('1')}".rstrip()
        raise ConfigurationError(
            'The threshold must be a share between 0 and 100 %, such as "10 %", or a rate greater than zero with its '
            f'unit, such as "2 mm3/ms", not {read}.'
        )
    return Threshold(value, unit)


def _parse_threshold(text: str) -> tuple[float, str]:
    for unit in ("1", "m3/s", "kg/s"):
        try:
            return parse(text, unit), unit
        except InputError:
            continue
    raise ConfigurationError(
        f'The threshold must be a share such as "10 %" or a rate such as "2 mm3/ms" or "2 mg/ms", not "{text}".'
    )
