"""Numbers as the report writes them; a missing number is a dash."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from commonrail.units import to_text

__all__ = [
    "MISSING",
    "counted",
    "duration",
    "fixed",
    "listed",
    "megapascal",
    "number",
    "percent",
    "pressure",
    "quantity",
    "signed",
    "significant",
]

MISSING = "–"
_PRETTY = {"mm3": "mm³", "cm3": "cm³", "mm2": "mm²", "m3": "m³", "m2": "m²", "ohm": "Ω"}
_PRETTY |= {"um": "µm", "us": "µs", "N/um": "N/µm", "um/MPa": "µm/MPa", "mohm": "mΩ"}


def number(value: Any) -> float | None:
    """A finite number, or None: what a failed simulation leaves."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value) if math.isfinite(value) else None


def fixed(value: Any, decimals: int, scale: float = 1.0) -> str:
    """Number times `scale` with so many decimals."""
    found = number(value)
    return MISSING if found is None else f"{found * scale:.{decimals}f}"


def significant(value: Any, digits: int = 4, scale: float = 1.0) -> str:
    """Number times `scale` with so many significant digits, without an exponent from 1 to a million."""
    found = number(value)
    if found is None:
        return MISSING
    rounded = f"{found * scale:.{digits}g}"
    return f"{float(rounded):.0f}" if "e+" in rounded and abs(float(rounded)) < 1e6 else rounded


def signed(value: Any, decimals: int) -> str:
    """Number with its sign, a true minus, and no sign at zero."""
    found = number(value)
    if found is None:
        return MISSING
    text = f"{abs(found):.{decimals}f}"
    return text if not float(text) else ("+" if found > 0.0 else "−") + text


def percent(share: Any, decimals: int = 1) -> str:
    """Share as a percentage, without the sign %."""
    return fixed(share, decimals, 100.0)


def pressure(value: Any) -> str:
    """Pressure [Pa] in MPa with its unit."""
    return f"{megapascal(value)} MPa"


def megapascal(value: Any) -> str:
    """Pressure [Pa] as a number of MPa."""
    return significant(value, 4, 1e-6)


def quantity(value: Any, unit: str, digits: int = 4) -> str:
    """Value of any SI unit with the prefix that suits it."""
    found = number(value)
    if found is None:
        return MISSING
    amount, _, shown = to_text(found, unit, digits).partition(" ")
    return f"{amount} {_PRETTY.get(shown, shown)}".strip()


def duration(seconds: Any) -> str:
    """Time that something took."""
    found = number(seconds)
    if found is None:
        return MISSING
    if found < 60.0:
        return f"{found:.1f} s"
    minutes, rest = divmod(round(found), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {rest} s"


def counted(count: int, noun: str, nouns: str = "") -> str:
    """Number with its noun in the singular or the plural, by default with an s: 1 rail pressure, 2 rail pressures."""
    return f"{count} {noun if count == 1 else nouns or f'{noun}s'}"


def listed(words: Sequence[str]) -> str:
    """Words as a sentence lists them: a, b and c."""
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} and {words[-1]}"
