"""Letters of drawings: widths, what is cut, and names that stand upright where they do not fit beside one another."""

from __future__ import annotations

from collections.abc import Sequence

__all__ = ["LONGEST", "SIZE", "cut", "text_width", "upright"]

SIZE = 11.5  # of letters [px]
LONGEST = 150.0  # names that stand upright [px]
BETWEEN = 4.0  # names [px]


def text_width(text: str) -> float:
    """Width of a text [px], near enough to set others beside it."""
    return sum(0.3 if c in "iljt.,:;'|!() " else 0.85 if c in "mwMW%@" else 0.58 for c in text) * SIZE


def cut(text: str, width: float) -> str:
    """Text that fits a width [px], with an ellipsis where it is cut."""
    if text_width(text) <= width + 1.0:
        return text
    while len(text) > 1 and text_width(text + "…") > width:
        text = text[:-1]
    return text + "…"


def upright(names: Sequence[str], width: float) -> float:
    """Room for names that stand upright below columns of a width, as they do not fit there [px]; 0 where they do."""
    longest = max(map(text_width, names), default=0.0)
    return min(longest, LONGEST) if longest > width - BETWEEN else 0.0
