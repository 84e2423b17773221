"""Axis of a drawing: places in pixels, round ticks and their texts."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from commonrail.base.arrays import Floats

ROUNDING = 1e-9  # relative to the largest value; rounding of sums of doubles is smaller
PADDING = 0.04  # of the range, on either side
OTHER_SIDE = 0.2  # part of the axis beyond zero, relative to the values on their side


@dataclass(frozen=True)
class Axis:
    """Map from values to pixels from `start` to `end`; values of a logarithmic axis are positive."""

    low: float
    high: float
    start: float
    end: float
    logarithmic: bool = False

    def at(self, value: float) -> float:
        """Place of a value [px]."""
        low, high, value = (self._to_scale(v) for v in (self.low, self.high, value))
        return self.start + (value - low) / (high - low) * (self.end - self.start)

    def places(self, values: Sequence[float | None] | Floats) -> Floats:
        """Places of values [px]; NaN for a missing value, and on a logarithmic axis for one that is not positive."""
        if self.logarithmic:
            values = [self._to_scale(v) if v is not None and v > 0.0 else None for v in values]
        low, high = self._to_scale(self.low), self._to_scale(self.high)
        return np.asarray(self.start + (np.array(values, float) - low) / (high - low) * (self.end - self.start))

    def _to_scale(self, value: float) -> float:
        return math.log10(max(value, 1e-300)) if self.logarithmic else value

    def ticks(self, most: int) -> list[tuple[float, str]]:
        """Round values between the ends, about `most` of them, each with its text."""
        values = _log_ticks(self.low, self.high, most) if self.logarithmic else _ticks(self.low, self.high, most)
        step = values[1] - values[0] if len(values) > 1 else 0.0
        return [(value, _text(value, 0.0 if self.logarithmic else step)) for value in values]


def span(
    values: Iterable[float], zero: bool = False, padded: bool = True, both_sides: bool = False
) -> tuple[float, float]:
    """Ends of an axis that shows all values, and zero if asked for; `padded` leaves some space on either side.

    With `both_sides` zero is no end of the axis, which would cut markers there.
    """
    numbers = list(values)
    if zero:
        numbers.append(0.0)
    low, high = (min(numbers), max(numbers)) if numbers else (0.0, 1.0)
    size = max(abs(low), abs(high))
    if high - low <= ROUNDING * size:  # constant but for rounding
        return (low - 0.05 * size, high + 0.05 * size) if size else (-1.0, 1.0)
    if both_sides:
        low, high = min(low, -OTHER_SIDE * high), max(high, -OTHER_SIDE * low)
    room = PADDING * (high - low) if padded else 0.0
    return low - room, high + room


def _ticks(low: float, high: float, most: int) -> list[float]:
    """About `most` ticks at multiples of 1, 2 or 5 times a power of ten; more if there were only one."""
    rough = (high - low) / max(most, 1)
    power = 10.0 ** math.floor(math.log10(rough))
    steps = [digit * power for digit in (0.2, 0.5, 1.0, 2.0, 5.0, 10.0)]
    fitting = next(i for i, step in enumerate(steps) if step >= rough * (1.0 - 1e-9))
    ticks: list[float] = []
    for step in steps[fitting::-1]:
        first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
        ticks = [i * step for i in range(first, last + 1)]
        if len(ticks) > 1:
            break
    return ticks


def _log_ticks(low: float, high: float, most: int) -> list[float]:
    """1, 2 and 5 times the powers of ten, or the powers alone where there are many."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    for digits in ((1, 2, 5), (1,)):
        ticks = [
            d * 10.0**p for p in decades for d in digits if low <= d * 10.0**p * (1 + 1e-9) and d * 10.0**p <= high
        ]
        if len(ticks) <= max(most, 3):
            return ticks
    return ticks[:: -(-len(ticks) // max(most, 3))]


def _text(value: float, step: float) -> str:
    """Number of a tick, with the decimals of the step and a true minus."""
    size = max(abs(value), step)
    if size >= 1e6 or 0.0 < size < 1e-4:
        text = f"{value:.6g}"
    elif step:
        decimals = max(0, -math.floor(math.log10(step) + 1e-9))
        text = f"{value:.{decimals}f}"
    else:
        text = f"{value:.10g}"
    return text.replace("-", "−") if float(text) else "0"


# Letters of drawings: widths, shortened names, and upright names where they do not fit next to one another.

SIZE = 11.5  # of letters [px]
INK = "#1d2733"
FONT = "system-ui, -apple-system, 'Segoe UI', 'Liberation Sans', Arial, sans-serif"
WIDE, NARROW = 760, 352  # widths that figures are drawn for [px]: a page and a sheet of paper, a telephone
LONGEST = 200.0  # upright names [px]
BETWEEN = 4.0  # names [px]


def text_width(text: str) -> float:
    """Width of a text [px], near enough to place others next to it."""
    return sum(0.3 if c in "iljt.,:;'|!() " else 0.85 if c in "mwMW%@" else 0.58 for c in text) * SIZE


def shorten(text: str, width: float) -> str:
    """Text that fits a width [px], with an ellipsis for its middle: long names often differ at their ends."""
    if text_width(text) <= width + 1.0:
        return text
    letters = len(text) - 1
    while letters > 2 and text_width(text[: letters - letters // 2] + "…" + text[-(letters // 2) :]) > width:
        letters -= 1
    return text[: letters - letters // 2] + "…" + text[-(letters // 2) :]


def upright(names: Sequence[str], width: float) -> float:
    """Room for upright names below columns of a width [px]; 0 where the names fit as they are."""
    longest = max(map(text_width, names), default=0.0)
    return min(longest, LONGEST) if longest > width - BETWEEN else 0.0
