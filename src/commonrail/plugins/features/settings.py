"""Settings of features: thresholds and averaging."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from commonrail.base.arguments import Limits, Quantity, fraction, number, sequence
from commonrail.base.declare import Number, OptionalNumber, Setting, setting, settings
from commonrail.base.errors import ConfigurationError, InputError
from commonrail.base.units import parse, to_text

AVERAGINGS = Limits(1e-9, 1e-3, (1e-6, 1e-3), ("us",))  # [s]
TIMES = Limits(0.0, 0.1, (1e-6, 0.1), ("us", "ms"))  # [s]


class Threshold(NamedTuple):
    """Threshold of the rate: a share of the largest rate (unit "1"), or a rate [m³/s or kg/s]."""

    value: float
    unit: str = "1"

    def __str__(self) -> str:
        return f"{100.0 * self.value:g} %" if self.unit == "1" else to_text(self.value, self.unit)


def _read_threshold(threshold: object, _: str) -> Threshold:
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


def _read_ramp(value: object, words: str) -> tuple[float, float]:
    shares = sequence(value, words, "(0.2, 0.8)")
    if len(shares) != 2:
        raise ConfigurationError("The ramp must be two shares of the largest rate, such as (0.2, 0.8).")
    low, high = (fraction(share, words) for share in shares)
    if not low < high:
        raise ConfigurationError(f"The shares of the ramp must increase, not {low:g} and {high:g}.")
    return low, high


@settings(kw_only=False)
class FeatureSettings:
    """Thresholds and averaging of features; `ConfigurationError` if a value cannot be read or is out of range."""

    threshold: Setting[Threshold, Threshold | Quantity] = setting(
        default="10%",
        read=_read_threshold,
        text="Rate of opening and closing: a share of the largest, or e.g. 2mm3/ms.",
    )
    hysteresis: Number = setting(
        default="50%",
        read=fraction,
        text="Share of the threshold by which the rate must rise above it for an injection to count, and fall below it "
        "for the next to begin.",
        option=False,
    )
    split: Number = setting(
        default="50%",
        read=fraction,
        text="Fused injections are divided if the rate between them falls below this share of the smaller peak.",
    )
    ramp: Setting[tuple[float, float], Sequence[Quantity]] = setting(
        default=(0.2, 0.8),
        read=_read_ramp,
        text="Shares of the largest rate between which ramps are timed.",
        option=False,
    )
    averaging: OptionalNumber = setting(
        unit="s",
        default=None,
        limits=AVERAGINGS,
        text="Averaging time of the rate. [default: a sample; up to 25us with noise]",
    )
    peak_averaging: Number = setting(
        unit="s",
        default="50us",
        limits=AVERAGINGS,
        text="Averaging time of the largest rate.",
        option=False,
    )
    tail: Number = setting(
        unit="s",
        default="500us",
        limits=TIMES,
        text="Time beyond opening and closing that counts for the quantity.",
    )
    least_delay: Number = setting(
        unit="s",
        default="100us",
        limits=TIMES,
        text="Shortest time from the start of an energising to its injection.",
        option=False,
    )
    zero_at_rest: bool = setting(default=False, text="Subtract the mean rate before the first energising.")
