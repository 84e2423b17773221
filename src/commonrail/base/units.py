"""Text with a unit ("160 MPa", "700 us") to SI floats and back: the edge of the project.

Inside the project every number is an SI float. This module is the only user of pint. Everyday units are in `FACTORS`
and avoid building pint's registry (about 0.4 s); any other unit is handed to pint.
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
from typing import TYPE_CHECKING, Any, NamedTuple, overload

from commonrail.base.errors import InputError, nearest

if TYPE_CHECKING:
    from commonrail.base.arrays import Floats

# The units that the field writes every day: their kinds, factors to SI, names and examples.
#
# Data only; `units` reads it. Every entry is held to pint's answer by a test.


class Scale(NamedTuple):
    """SI value = factor · value + offset, in the SI unit that names the kind of quantity."""

    kind: str
    factor: float
    offset: float = 0.0


# Kind (its SI unit) → spellings → factor to SI. Names follow pint, with powers as plain digits.
FACTORS: dict[str, dict[str, float]] = {
    "1": {"1": 1.0, "%": 0.01, "rad": 1.0, "deg": math.pi / 180.0},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "nm": 1e-9},
    "m2": {"m2": 1.0, "cm2": 1e-4, "mm2": 1e-6, "um2": 1e-12},
    "m3": {"m3": 1.0, "L": 1e-3, "cm3": 1e-6, "mm3": 1e-9, "mm3/stroke": 1e-9},
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0},
    "1/s": {"1/s": 1.0, "Hz": 1.0, "kHz": 1e3, "MHz": 1e6},
    "m/s": {"m/s": 1.0, "mm/s": 1e-3, "mm/ms": 1.0},
    "m/s2": {"m/s2": 1.0},
    "s/m": {"s/m": 1.0},
    "kg": {"kg": 1.0, "g": 1e-3, "mg": 1e-6, "mg/stroke": 1e-6},
    "kg/s": {"kg/s": 1.0, "g/s": 1e-3, "mg/s": 1e-6, "mg/ms": 1e-3, "N s/m": 1.0},
    "m3/s": {"m3/s": 1.0, "cm3/s": 1e-6, "mm3/s": 1e-9, "mm3/ms": 1e-6, "L/min": 1e-3 / 60.0},
    "kg/m3": {"kg/m3": 1.0, "g/cm3": 1e3},
    "N": {"N": 1.0, "kN": 1e3, "mN": 1e-3},
    "N/m": {"N/m": 1.0, "N/mm": 1e3, "N/um": 1e6, "kN/mm": 1e6},
    "Pa": {
        "Pa": 1.0,
        "hPa": 1e2,
        "kPa": 1e3,
        "MPa": 1e6,
        "GPa": 1e9,
        "bar": 1e5,
        "mbar": 1e2,
        "psi": 6894.757293168361,
    },
    "1/Pa": {"1/Pa": 1.0, "1/MPa": 1e-6, "1/bar": 1e-5},
    "m/Pa": {"m/Pa": 1.0, "um/MPa": 1e-12, "um/bar": 1e-11},
    "Pa s": {"Pa s": 1.0, "mPa s": 1e-3},
    "m2/s": {"m2/s": 1.0, "mm2/s": 1e-6, "cSt": 1e-6},
    "J": {"J": 1.0, "mJ": 1e-3, "kJ": 1e3, "N m": 1.0},
    "W": {"W": 1.0, "mW": 1e-3, "kW": 1e3},
    "V": {"V": 1.0, "mV": 1e-3, "kV": 1e3},
    "A": {"A": 1.0, "mA": 1e-3},
    "ohm": {"ohm": 1.0, "mohm": 1e-3, "kohm": 1e3, "V/A": 1.0},
    "S": {"S": 1.0},
    "H": {"H": 1.0, "mH": 1e-3, "uH": 1e-6},
    "1/H": {"1/H": 1.0},
    "H/m": {"H/m": 1.0},
    "A/m": {"A/m": 1.0},
    "Wb": {"Wb": 1.0, "mWb": 1e-3},
    "T": {"T": 1.0, "mT": 1e-3},
    "K": {"K": 1.0},
    "1/K": {"1/K": 1.0},
}
FAST = {name: Scale(kind, factor) for kind, names in FACTORS.items() for name, factor in names.items()} | {
    "degC": Scale("K", 1.0, 273.15)
}

# Words for a kind of quantity, or for one of its units, and an example, for messages.
NAMES: dict[str, tuple[str, str]] = {
    "1": ("a plain number", "0.8"),
    "m": ("a length", "0.2 mm"),
    "m2": ("an area", "70 mm2"),
    "m3": ("a volume", "150 mm3"),
    "s": ("a time", "700 us"),
    "1/s": ("a frequency", "1000 1/min"),
    "Hz": ("a frequency", "20 kHz"),
    "m/s": ("a speed", "1300 m/s"),
    "kg": ("a mass", "5 g"),
    "kg/s": ("a mass flow or a damping", "20 mg/ms"),
    "m3/s": ("a volume flow", "50 mm3/ms"),
    "kg/m3": ("a density", "830 kg/m3"),
    "N": ("a force", "72 N"),
    "N/m": ("a stiffness", "20 N/mm"),
    "Pa": ("a pressure", "160 MPa"),
    "m/Pa": ("a length per pressure", "0.02 um/MPa"),
    "Pa s": ("a dynamic viscosity", "3 mPa s"),
    "m2/s": ("a kinematic viscosity", "2.6 mm2/s"),
    "J": ("an energy or a torque", "30 mJ"),
    "W": ("a power", "50 W"),
    "V": ("a voltage", "65 V"),
    "A": ("a current", "18 A"),
    "ohm": ("a resistance", "0.2 ohm"),
    "H": ("an inductance", "0.2 mH"),
    "Wb": ("a magnetic flux", "0.1 mWb"),
    "T": ("a flux density", "1.5 T"),
    "K": ("a temperature", "80 degC"),
}

# What `to_text` may choose from, largest first.
SHOWN: dict[str, tuple[str, ...]] = {
    "m": ("m", "mm", "um", "nm"),
    "m2": ("mm2",),
    "m3": ("cm3", "mm3"),
    "s": ("s", "ms", "us", "ns"),
    "1/s": ("1/s",),
    "Hz": ("MHz", "kHz", "Hz"),
    "kg": ("kg", "g", "mg"),
    "kg/s": ("kg/s", "mg/ms"),
    "m3/s": ("mm3/ms",),
    "N": ("kN", "N", "mN"),
    "N/m": ("N/um", "N/mm", "N/m"),
    "Pa": ("GPa", "MPa", "kPa", "Pa"),
    "m/Pa": ("um/MPa",),
    "Pa s": ("Pa s", "mPa s"),
    "m2/s": ("mm2/s",),
    "J": ("kJ", "J", "mJ"),
    "W": ("kW", "W", "mW"),
    "V": ("V", "mV"),
    "A": ("A", "mA"),
    "ohm": ("ohm", "mohm"),
    "H": ("H", "mH", "uH"),
    "Wb": ("Wb", "mWb"),
}


def read_decimal(text: str) -> float:
    """Number of a text; `ValueError` for what Python reads besides: underscores, and digits of other scripts."""
    if "_" in text or not text.isascii():
        raise ValueError(text)
    return float(text)


_NUMBER = re.compile(r"([+-]?(?:(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|inf(?:inity)?\b|nan\b))(.*)", re.S | re.A)
# What quantities of a stroke are counted by: "mg/Hub", "mm3/Takt".
_STROKE = re.compile(r"/(?:inj|injection|str|stk|shot|hub|takt|einspritzung|(?-i:H))\.?$", re.I)
# Crank angle with its engine speed, a time.
_CRANK = re.compile(r"deg ?(?:CA|CrA|KW|crk)? ?@ ?(\d+(?:\.\d+)?) ?(?:rpm|1/min|U/min|/min)", re.I)
# Units as words and abbreviations of headings, in small letters.
_WORDS = {
    **dict.fromkeys(("sec", "second", "seconds", "sek", "sekunde", "sekunden"), "s"),
    **dict.fromkeys(("msec", "millisecond", "milliseconds", "millisekunden"), "ms"),
    **dict.fromkeys(("usec", "microsecond", "microseconds", "mikrosekunden"), "us"),
    **dict.fromkeys(("volt", "volts"), "V"),
    **dict.fromkeys(("amp", "amps", "ampere", "amperes"), "A"),
    **dict.fromkeys(("percent", "prozent"), "%"),
    **dict.fromkeys(("celsius", "deg c", "grad c", "grad celsius"), "degC"),
    "bar": "bar",
    "psi": "psi",
    "ccm": "cm3",
    "cc": "cm3",
    "cmm": "mm3",
}
# Absolute or gauge pressure: "bar(a)", "bar abs", "barg", "MPa (rel)".
_GAUGE = re.compile(r"([kMh]?Pa|m?bar)[ _]*\(?(?:(abs|a)|(gauge|rel|g))\.?\)?", re.I)
ATMOSPHERE = 101325.0  # [Pa]
_LOOKALIKES = str.maketrans({"μ": "u", "Ω": "ohm", "°": "deg", "−": "-", "·": " ", "⋅": " "})


def parse(text: str | float, unit: str, where: str = "") -> float:
    """Read a number with its unit.

    `text` is such as "160 MPa", "1600bar" or "-3 µm"; without a unit only where `unit` is "1". The value is finite, the
    one nearest to the decimal text. `where`, a file, line or key, opens the message of an error. Raises `InputError`
    if the number is missing or not finite, or the unit is missing, unknown or of another kind.

    Examples
    --------
    >>> parse("1600 bar", "Pa")
    160000000.0
    >>> parse("80 degC", "K")
    353.15
    """
    target = _find_scale(unit, where)
    expected = _expectation(target.kind, unit)
    number, written = _split_number(text, expected, where)
    quoted = _quote(text if isinstance(text, str) else number)
    if not written and unit != "1":
        raise _error(where, f"{quoted} has no unit; {expected}", code="no-unit")
    source = _find_scale(written or "1", where, expected)
    if source.kind != target.kind:
        raise _error(where, f"{quoted} is {_name(source.kind)}; {expected}", code="wrong-unit")
    value = _rescale(number, source, target)
    if not math.isfinite(value):
        raise _error(where, f"{quoted} is not finite; {expected}", code="not-finite")
    return value


def parse_difference(text: str | float, unit: str, where: str = "") -> float:
    """Read a difference of two values with its unit, such as a tolerance: 3 degC and 3 K are the same.

    `unit`: unit of the result. Raises `InputError` as in `parse`.

    Examples
    --------
    >>> parse_difference("2 degC", "K")
    2.0
    """
    value = parse(text, unit, where)
    number, written = _split_number(text, unit, where)
    source, target = _find_scale(written or "1", where), _find_scale(unit, where)
    if source.offset == target.offset == 0.0:
        return value
    return _rescale(number, source._replace(offset=0.0), target._replace(offset=0.0))


@overload
def convert(value: float, source_unit: str, target_unit: str, where: str = "") -> float: ...
@overload
def convert(value: Floats, source_unit: str, target_unit: str, where: str = "") -> Floats: ...
def convert(value: Any, source_unit: str, target_unit: str, where: str = "") -> Any:
    """Convert a float or an array, of any shape, from one unit to another.

    Angular speed and frequency are different kinds: rpm does not convert to Hz.

    Not-a-number passes through; an offset unit such as degC is a point on its scale. `where` as for `parse`. Raises
    `InputError` if a unit is unknown, or the two are of different kinds.
    """
    source, target = _find_scale(source_unit, where), _find_scale(target_unit, where)
    if source.kind != target.kind:
        raise _error(
            where,
            f"{_quote(source_unit)} is a unit of {_name(source.kind)} and cannot become "
            f"{_quote(target_unit)}, a unit of {_name(target.kind)}",
            code="wrong-unit",
        )
    if source == target:
        return value * 1.0
    return value * (source.factor / target.factor) + (source.offset - target.offset) / target.factor


def compatible(a: str, b: str) -> bool:
    """Tell whether two units measure the same kind of quantity; InputError for an unknown unit."""
    return _find_scale(a, "").kind == _find_scale(b, "").kind


def is_everyday(unit: str) -> bool:
    """Tell whether a text is a unit that the field writes every day, without asking pint."""
    return _of_table(_plain(unit)) is not None


def same_scale(unit: str, other: str) -> bool:
    """Tell whether two units are the same under different names; InputError for an unknown unit."""
    return _find_scale(unit, "") == _find_scale(other, "")


def fits(unit: str, kind: str) -> bool:
    """Tell whether a text is a unit of the same kind of quantity as another; False for an unknown unit."""
    scale, other = _scale(unit), _scale(kind)
    return scale is not None and other is not None and scale.kind == other.kind


def to_text(value: float, unit: str, digits: int = 6) -> str:
    """Write an SI value for a person to read, with the prefix that suits its size.

    The value is in `unit`; units other than SI are kept, and "1" is not written. `parse` reads the text
    back to the same significant `digits`.

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


def _rescale(number: str, source: Scale, target: Scale) -> float:
    """Scale in decimal: "215 um" becomes the same float as 215e-6. The result may be infinite."""
    value = float(number)
    # Decimal refuses exponents that a float rounds to zero or to infinity.
    decimal = Decimal(number) if value and math.isfinite(value) else Decimal(value)
    exact = decimal * Decimal(repr(source.factor)) + Decimal(repr(source.offset))
    return float((exact - Decimal(repr(target.offset))) / Decimal(repr(target.factor)))


def _split_number(text: object, expected: str, where: str) -> tuple[str, str]:
    """Number and unit as written; the number is kept as text, for exact scaling."""
    if isinstance(text, bool) or not isinstance(text, (str, Real)):
        raise _error(where, f"{_quote(text)} is not a number with a unit; {expected}", code="not-a-number")
    if isinstance(text, Real):
        with suppress(OverflowError):
            return repr(float(text)), ""
        return "inf", ""
    if re.search(r"\d,\d", text):
        raise _error(where, f"{_quote(text)} has a comma; write the decimal sign as a point", code="decimal-comma")
    if text.strip() == "?":
        raise _error(where, f'"?" stands for what no file told; state it: {expected}', code="open-value")
    match = _NUMBER.fullmatch(unicodedata.normalize("NFKC", text).replace("−", "-").strip())
    if not match:
        raise _error(where, f"{_quote(text)} does not start with a number; {expected}", code="not-a-number")
    return match[1], match[2].strip()


def _find_scale(unit: str, where: str, expected: str = "") -> Scale:
    scale = _scale(unit)
    if scale is None:
        meant = nearest(unit, FAST) + (expected and f"; {expected}")
        raise _error(where, f"{_quote(unit)} is not a known unit{meant}", code="unknown-unit")
    return scale


@lru_cache(maxsize=512)
def _scale(unit: str) -> Scale | None:
    text = _plain(unit)
    return _of_table(text) or _ask_pint(text)


def _plain(unit: str) -> str:
    """Spelling of a unit in the table: powers as plain digits, single spaces, "/stroke" for what counts strokes."""
    text = unicodedata.normalize("NFKC", unit).translate(_LOOKALIKES)
    # A power is a letter followed by digits; other spellings of powers are refused below.
    text = re.sub(r"(?<=[A-Za-z])\s*(?:\*\*|\^)\s*(?=-?\d)", "", text).replace("**", "^")
    text = re.sub(r"\s*/\s*", "/", " ".join(text.replace("*", " ").split()))
    return _STROKE.sub("/stroke", f"1{text}" if text.startswith("/") else text)


def _of_table(text: str) -> Scale | None:
    """Scale of a plain spelling in the table, of a word for it, or of a pressure with its reference."""
    if match := _GAUGE.fullmatch(text):
        scale = _of_table(match[1])
        return scale and scale._replace(offset=ATMOSPHERE if match[3] else 0.0)
    if (match := _CRANK.fullmatch(text)) and float(match[1]) > 0.0:
        return Scale("s", 1.0 / (6.0 * float(match[1])))  # 360 degrees a turn, 60 s a minute
    return FAST.get(text) or FAST.get(_WORDS.get(text.lower(), ""))


def _ask_pint(text: str) -> Scale | None:
    # Only short products of small powers: pint would spend minutes on the integer 1000**99999999.
    if not text or len(text) > 60 or "^" in text or re.search(r"\d{3}", text):
        return None
    registry, kinds = _pint()
    try:
        parsed = registry.parse_units(re.sub(r"(?<=[A-Za-z])(-?\d+)", r"**\1", text))
        zero, unity, two = (registry.Quantity(x, parsed).to_base_units() for x in (0.0, 1.0, 2.0))
        offset, factor = float(zero.magnitude), float(unity.magnitude - zero.magnitude)
        linear = math.isclose(two.magnitude - unity.magnitude, factor, rel_tol=1e-9)
    except Exception:  # pint answers malformed text with a dozen unrelated exception types
        return None
    if not (linear and math.isfinite(factor) and factor > 0.0):
        return None
    base = str(unity.units)
    return Scale(kinds.get(base, base), factor, offset)


@lru_cache(maxsize=1)
def _pint() -> tuple[Any, dict[str, str]]:
    """Pint's registry, built once, and the table's kinds by pint's name of their base units."""
    import pint

    registry: Any = pint.UnitRegistry()
    registry.define("stroke = count")
    spellings = {kind: re.sub(r"(?<=[A-Za-z])(\d+)", r"**\1", kind) for kind in FACTORS}
    bases = {str(registry.Quantity(1, text).to_base_units().units): k for k, text in spellings.items()}
    return registry, bases | {"radian": "1"}


def _name(kind: str) -> str:
    return NAMES[kind][0] if kind in NAMES else f"a quantity in {kind}"


def _expectation(kind: str, unit: str) -> str:
    name, example = NAMES.get(unit) or NAMES.get(kind, (f"a quantity in {unit}", f"3 {unit}"))
    return f'{name} is expected, for example "{example}"'


def _quote(text: object) -> str:
    """One short line, whatever was in the file."""
    line = " ".join(text.split()) if isinstance(text, str) else reprlib.repr(text)
    return f'"{line if len(line) <= 40 else line[:37] + "..."}"'


def _error(where: str, sentence: str, code: str) -> InputError:
    return InputError(f"{where}: {sentence}." if where else f"{sentence}.", code=code, place=where)
