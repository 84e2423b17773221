"""Numbers as the report writes them; a missing number is a dash."""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from commonrail.base.units import convert, to_text

MISSING = "–"
_PRETTY = {"mm3": "mm³", "cm3": "cm³", "mm2": "mm²", "m3": "m³", "m2": "m²", "ohm": "Ω"}
_PRETTY |= {"um": "µm", "us": "µs", "N/um": "N/µm", "um/MPa": "µm/MPa", "mohm": "mΩ", "mm3/ms": "mm³/ms", "degC": "°C"}
# Unit in which the field states all values of an SI unit, whatever their size, and its factor.
_FIELD = {
    "Pa": ("MPa", 1e-6),
    "s": ("us", 1e6),
    "m": ("um", 1e6),
    "m3": ("mm3", 1e9),
    "kg": ("mg", 1e6),
    "m3/s": ("mm3/ms", 1e6),
    "kg/s": ("mg/ms", 1e3),
}


class FieldUnit(NamedTuple):
    """Unit in which the field states a quantity: its name in files, text on pages, and factor from SI."""

    name: str
    text: str
    factor: float


def field_unit(unit: str) -> FieldUnit:
    """Unit in which the field states values of an SI unit; "1" has no text, and other units are left as they are."""
    name, factor = _FIELD.get(unit, (unit, 1.0))
    return FieldUnit(name, "" if unit == "1" else in_print(name), factor)


def in_print(unit: str) -> str:
    """Name of a unit as pages print it: µs for us."""
    return _PRETTY.get(unit, unit)


def number(value: Any) -> float | None:
    """A finite number, or None: what a failed simulation leaves."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value) if math.isfinite(value) else None


def numbers(values: Any) -> list[Any]:
    """Array, or nested lists, as nested lists of finite numbers and None."""
    rows = values if isinstance(values, list) else values.tolist()
    return [numbers(row) if isinstance(row, list) else number(row) for row in rows]


def to_fixed(value: Any, decimals: int, scale: float = 1.0) -> str:
    """Number times `scale` with so many decimals."""
    finite = number(value)
    return MISSING if finite is None else f"{finite * scale:.{decimals}f}"


def significant(value: Any, digits: int = 4, scale: float = 1.0) -> str:
    """Number times `scale` with so many significant digits, without an exponent from 1 to a million."""
    finite = number(value)
    if finite is None:
        return MISSING
    return _in_print(f"{finite * scale:.{digits}g}")


_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def _in_print(amount: str) -> str:
    """A number with a true minus, and an exponent as a power of ten: "−2.4e-10" as −2.4·10⁻¹⁰."""
    if "e+" in amount and abs(float(amount)) < 1e6:
        amount = f"{float(amount):.0f}"
    digits, _, exponent = amount.partition("e")
    power = f"·10{str(int(exponent)).translate(_RAISED)}" if exponent else ""
    return digits.replace("-", "−") + power


def to_signed(value: Any, decimals: int) -> str:
    """Number with its sign, a true minus, and no sign at zero."""
    finite = number(value)
    if finite is None:
        return MISSING
    text = f"{abs(finite):.{decimals}f}"
    return text if not float(text) else ("+" if finite > 0.0 else "−") + text


def percent(share: Any, decimals: int = 1) -> str:
    """Share as a percentage, without the sign %."""
    return to_fixed(share, decimals, 100.0)


def pressure(value: Any) -> str:
    """Pressure [Pa] in MPa with its unit."""
    return f"{megapascal(value)} MPa"


def megapascal(value: Any) -> str:
    """Pressure [Pa] as a number of MPa."""
    return significant(value, 4, 1e-6)


def quantity(value: Any, unit: str, digits: int = 4) -> str:
    """Value of any SI unit with the prefix that suits it."""
    finite = number(value)
    if finite is None:
        return MISSING
    amount, _, shown = to_text(finite, unit, digits).partition(" ")
    return f"{_in_print(amount)} {in_print(shown)}".strip()


def shown_unit(value: float, unit: str) -> tuple[str, float]:
    """Unit in which `quantity` writes a value of an SI unit, and its factor from SI."""
    name = to_text(value, unit).partition(" ")[2] if value else field_unit(unit).name
    if name in ("", unit):
        return ("" if unit == "1" else in_print(unit)), 1.0
    return in_print(name), convert(1.0, unit, name)


def quantity_range(low: Any, high: Any, unit: str, digits: int = 4) -> str:
    """Two values of an SI unit, whose unit is written once where it is that of both: "20 to 100 N/µm"."""
    first, second = "0" if low == 0.0 else quantity(low, unit, digits), quantity(high, unit, digits)
    amount, _, shown = first.partition(" ")
    return f"{amount if shown and second.endswith(f' {shown}') else first} to {second}"


def duration(seconds: Any) -> str:
    """Time that something took."""
    elapsed = number(seconds)
    if elapsed is None:
        return MISSING
    if elapsed < 60.0:
        return f"{elapsed:.1f} s"
    minutes, rest = divmod(round(elapsed), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {rest} s"


def count_noun(count: int, noun: str, nouns: str = "") -> str:
    """Number with its noun in the singular or the plural, by default with an s: 1 rail pressure, 2 rail pressures."""
    return f"{count:,} {noun if count == 1 else nouns or f'{noun}s'}"


def several(values: Sequence[Any], text: Callable[[Any], str]) -> str:
    """Values as a few texts beside one another, "+0.1 · 0.0", or as their range where there are more than three."""
    finite = [v for value in values if (v := number(value)) is not None]
    if len(finite) > 3:
        return " to ".join(dict.fromkeys((text(min(finite)), text(max(finite)))))
    return " · ".join(map(text, finite)) or MISSING


def command(*words: object) -> str:
    """Command line of commonrail that a message or a report advises, such as ``commonrail resume 'my run'``."""
    return shlex.join(["commonrail", *map(str, words)])


def join_words(words: Sequence[str]) -> str:
    """Words as a sentence lists them: a, b and c."""
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} and {words[-1]}"
