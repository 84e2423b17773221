"""Text with a unit ("160 MPa", "700 us") to SI floats and back: the edge of the project.

Inside the project every number is an SI float. This module is the only user of pint. The units
that the field writes every day are in `unit_table`, so that an ordinary file never pays for
building pint's registry (about 0.4 s); any other unit is handed to pint.
"""

from __future__ import annotations

import math
import re
import reprlib
import unicodedata
from contextlib import suppress
from decimal import Decimal
from functools import lru_cache
from numbers import Real
from typing import TYPE_CHECKING, Any, overload

from commonrail.errors import InputError, nearest
from commonrail.unit_table import FACTORS, FAST, NAMES, SHOWN, Scale

if TYPE_CHECKING:
    from commonrail.arrays import Floats

__all__ = ["compatible", "convert", "parse", "parse_difference", "to_text"]

_NUMBER = re.compile(r"([+-]?(?:(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|inf(?:inity)?\b|nan\b))(.*)", re.S)
_LOOKALIKES = str.maketrans({"μ": "u", "Ω": "ohm", "°": "deg", "−": "-", "·": " ", "⋅": " "})


def parse(text: str | float, unit: str, where: str = "") -> float:
    """Read a number with its unit.

    Parameters
    ----------
    text : str or float
        ``"160 MPa"``, ``"1600bar"``, ``"-3 µm"``; without a unit only where `unit` is ``"1"``.
    unit : str
        Unit of the result, as a rule the SI unit.
    where : str
        File, line or key; opens the message of an error.

    Returns
    -------
    float
        Finite value in `unit`, the one nearest to the decimal text.

    Raises
    ------
    InputError
        Not a number, no unit, an unknown unit, a unit of another kind, or not finite.

    Examples
    --------
    >>> parse("1600 bar", "Pa")
    160000000.0
    >>> parse("80 degC", "K")
    353.15
    """
    target = _known(unit, where)
    wanted = _expected(target.kind, unit)
    number, written = _split(text, wanted, where)
    given = _quoted(text if isinstance(text, str) else number)
    if not written and unit != "1":
        raise _error(where, f"{given} has no unit; {wanted}")
    source = _known(written or "1", where, wanted)
    if source.kind != target.kind:
        raise _error(where, f"{given} is {_name(source.kind)}; {wanted}")
    value = _rescaled(number, source, target)
    if not math.isfinite(value):
        raise _error(where, f"{given} is not finite; {wanted}")
    return value


def parse_difference(text: str | float, unit: str, where: str = "") -> float:
    """Read a difference of two values with its unit, such as a tolerance: 3 degC and 3 K are the same.

    Parameters
    ----------
    text : str or float
    unit : str
        Unit of the result.
    where : str
        As in `parse`.

    Raises
    ------
    InputError
        As in `parse`.

    Examples
    --------
    >>> parse_difference("2 degC", "K")
    2.0
    """
    value = parse(text, unit, where)
    number, written = _split(text, unit, where)
    source, target = _known(written or "1", where), _known(unit, where)
    if source.offset == target.offset == 0.0:
        return value
    return _rescaled(number, source._replace(offset=0.0), target._replace(offset=0.0))


@overload
def convert(value: float, source_unit: str, target_unit: str, where: str = "") -> float: ...
@overload
def convert(value: Floats, source_unit: str, target_unit: str, where: str = "") -> Floats: ...
def convert(value: Any, source_unit: str, target_unit: str, where: str = "") -> Any:
    """Convert a float or an array, of any shape, from one unit to another.

    Angular speed and frequency are told apart: rpm does not convert to Hz.

    Parameters
    ----------
    value : float or array
        Value in `source_unit`; not-a-number passes through.
    source_unit, target_unit : str
        Units of the same kind; an offset unit such as degC is a point on its scale.
    where : str
        File, line or key; opens the message of an error.

    Returns
    -------
    float or array
        Value in `target_unit`, same shape.

    Raises
    ------
    InputError
        A unit is unknown, or the two are of different kinds.
    """
    source, target = _known(source_unit, where), _known(target_unit, where)
    if source.kind != target.kind:
        raise _error(
            where,
            f"{_quoted(source_unit)} is a unit of {_name(source.kind)} and cannot become "
            f"{_quoted(target_unit)}, a unit of {_name(target.kind)}",
        )
    if source == target:
        return value * 1.0
    return value * (source.factor / target.factor) + (source.offset - target.offset) / target.factor


def compatible(a: str, b: str) -> bool:
    """Tell whether two units measure the same kind of quantity; InputError for an unknown unit."""
    return _known(a, "").kind == _known(b, "").kind


def fits(unit: str, kind: str) -> bool:
    """Tell whether a text is a unit of the same kind of quantity as another; False for an unknown unit."""
    try:
        return compatible(unit, kind)
    except InputError:
        return False


def to_text(value: float, unit: str, digits: int = 6) -> str:
    """Write an SI value for a person to read, with the prefix that suits its size.

    Parameters
    ----------
    value : float
        Value in `unit`.
    unit : str
        SI unit; any other unit is kept as it stands, and ``"1"`` is not written.
    digits : int
        Significant digits.

    Returns
    -------
    str
        Text that `parse` reads back to the same `digits`.

    Examples
    --------
    >>> to_text(160e6, "Pa"), to_text(7e-4, "s"), to_text(0.82, "1")
    ('160 MPa', '700 us', '0.82')
    """
    if unit == "1":
        return f"{value:.{digits}g}"
    rounded = float(f"{value:.{digits}g}")
    choices = SHOWN.get(unit, ())
    fitting = (name for name in choices if abs(rounded) >= FAST[name].factor)
    if rounded == 0.0 or not math.isfinite(rounded) or not choices:
        return f"{rounded:.{digits}g} {unit}"
    shown = next(fitting, choices[-1])
    text = f"{value / FAST[shown].factor:.{digits}g}"
    # Few digits of hundreds are written out: 120 ns, not 1.2e+02 ns.
    plain = f"{float(text):.0f}" if "e+" in text and abs(float(text)) < 1e6 else text
    return f"{plain} {shown}"


def _rescaled(number: str, source: Scale, target: Scale) -> float:
    """Scale in decimal, so that "215 um" is the float that 215e-6 is; may return an infinity."""
    value = float(number)
    # Decimal refuses exponents that a float rounds to zero or to infinity.
    decimal = Decimal(number) if value and math.isfinite(value) else Decimal(value)
    exact = decimal * Decimal(repr(source.factor)) + Decimal(repr(source.offset))
    return float((exact - Decimal(repr(target.offset))) / Decimal(repr(target.factor)))


def _split(text: object, wanted: str, where: str) -> tuple[str, str]:
    """Number and unit as written; the number is kept as text, for exact scaling."""
    if isinstance(text, bool) or not isinstance(text, (str, Real)):
        raise _error(where, f"{_quoted(text)} is not a number with a unit; {wanted}")
    if isinstance(text, Real):
        with suppress(OverflowError):
            return repr(float(text)), ""
        return "inf", ""
    if re.search(r"\d,\d", text):
        raise _error(where, f"{_quoted(text)} has a comma; write the decimal sign as a point")
    found = _NUMBER.fullmatch(unicodedata.normalize("NFKC", text).replace("−", "-").strip())
    if not found:
        raise _error(where, f"{_quoted(text)} does not start with a number; {wanted}")
    return found[1], found[2].strip()


def _known(unit: str, where: str, wanted: str = "") -> Scale:
    found = _scale(unit)
    if found is None:
        meant = nearest(unit, FAST) + (wanted and f"; {wanted}")
        raise _error(where, f"{_quoted(unit)} is not a known unit{meant}")
    return found


@lru_cache(maxsize=512)
def _scale(unit: str) -> Scale | None:
    text = unicodedata.normalize("NFKC", unit).translate(_LOOKALIKES)
    # A power is a letter followed by digits; what is left of other powers is refused below.
    text = re.sub(r"(?<=[A-Za-z])\s*(?:\*\*|\^)\s*(?=-?\d)", "", text).replace("**", "^")
    text = re.sub(r"\s*/\s*", "/", " ".join(text.replace("*", " ").split()))
    text = f"1{text}" if text.startswith("/") else text
    return FAST.get(text) or _ask_pint(text)


def _ask_pint(text: str) -> Scale | None:
    # Only short products of small powers: pint would spend minutes on the integer 1000**99999999.
    if not text or len(text) > 60 or "^" in text or re.search(r"\d{3}", text):
        return None
    registry, kinds = _pint()
    try:
        found = registry.parse_units(re.sub(r"(?<=[A-Za-z])(-?\d+)", r"**\1", text))
        zero, one, two = (registry.Quantity(x, found).to_base_units() for x in (0.0, 1.0, 2.0))
        offset, factor = float(zero.magnitude), float(one.magnitude - zero.magnitude)
        linear = math.isclose(two.magnitude - one.magnitude, factor, rel_tol=1e-9)
    except Exception:  # pint answers malformed text with a dozen unrelated exception types
        return None
    if not (linear and math.isfinite(factor) and factor > 0.0):
        return None
    base = str(one.units)
    return Scale(kinds.get(base, base), factor, offset)


@lru_cache(maxsize=1)
def _pint() -> tuple[Any, dict[str, str]]:
    """Pint's registry, built once, and the table's kinds by pint's name of their base units."""
    import pint

    registry: Any = pint.UnitRegistry()
    for per in ("stroke", "inj"):
        registry.define(f"{per} = count")
    named = {kind: re.sub(r"(?<=[A-Za-z])(\d+)", r"**\1", kind) for kind in FACTORS}
    bases = {str(registry.Quantity(1, text).to_base_units().units): k for k, text in named.items()}
    return registry, bases | {"radian": "1"}


def _name(kind: str) -> str:
    return NAMES[kind][0] if kind in NAMES else f"a quantity in {kind}"


def _expected(kind: str, unit: str) -> str:
    name, example = NAMES.get(kind, (f"a quantity in {unit}", f"3 {unit}"))
    return f'{name} is expected, for example "{example}"'


def _quoted(text: object) -> str:
    """One short line, whatever was in the file."""
    line = " ".join(text.split()) if isinstance(text, str) else reprlib.repr(text)
    return f'"{line if len(line) <= 40 else line[:37] + "..."}"'


def _error(where: str, sentence: str) -> InputError:
    return InputError(f"{where}: {sentence}." if where else f"{sentence}.")
