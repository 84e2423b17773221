"""The units that the field writes every day: their kinds, factors to SI, names and examples.

Data only; `units` reads it. Every entry is held to pint's answer by a test.
"""

import math
from typing import NamedTuple

__all__ = ["FACTORS", "FAST", "NAMES", "SHOWN", "Scale"]


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
    "m3": {"m3": 1.0, "L": 1e-3, "cm3": 1e-6, "mm3": 1e-9, "mm3/stroke": 1e-9, "mm3/inj": 1e-9},
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0},
    "1/s": {"1/s": 1.0, "Hz": 1.0, "kHz": 1e3, "MHz": 1e6},
    "m/s": {"m/s": 1.0, "mm/s": 1e-3, "mm/ms": 1.0},
    "m/s2": {"m/s2": 1.0},
    "s/m": {"s/m": 1.0},
    "kg": {"kg": 1.0, "g": 1e-3, "mg": 1e-6, "mg/stroke": 1e-6, "mg/inj": 1e-6},
    "kg/s": {"kg/s": 1.0, "g/s": 1e-3, "mg/s": 1e-6, "mg/ms": 1e-3, "N s/m": 1.0},
    "m3/s": {"m3/s": 1.0, "cm3/s": 1e-6, "mm3/s": 1e-9, "mm3/ms": 1e-6, "L/min": 1e-3 / 60.0},
    "kg/m3": {"kg/m3": 1.0, "g/cm3": 1e3},
    "N": {"N": 1.0, "kN": 1e3, "mN": 1e-3},
    "N/m": {"N/m": 1.0, "N/mm": 1e3, "N/um": 1e6, "kN/mm": 1e6},
    "Pa": {"Pa": 1.0, "hPa": 1e2, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9, "bar": 1e5, "mbar": 1e2},
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

# What a message calls a kind, and what it offers as an example.
NAMES: dict[str, tuple[str, str]] = {
    "1": ("a plain number", "0.8"),
    "m": ("a length", "0.2 mm"),
    "m2": ("an area", "70 mm2"),
    "m3": ("a volume", "150 mm3"),
    "s": ("a time", "700 us"),
    "1/s": ("a frequency", "20 kHz"),
    "m/s": ("a speed", "1300 m/s"),
    "kg": ("a mass", "5 g"),
    "kg/s": ("a mass flow or a damping", "20 mg/ms"),
    "m3/s": ("a volume flow", "50 mm3/ms"),
    "kg/m3": ("a density", "830 kg/m3"),
    "N": ("a force", "72 N"),
    "N/m": ("a stiffness", "20 N/mm"),
    "Pa": ("a pressure", "160 MPa"),
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
