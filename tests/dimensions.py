"""Laws of physics computed with pint: their documented units, and stand-ins for what pint does not do itself.

The plain function of a law runs unchanged. Only names of its module are replaced: `math`, `min` and `max` by twins
that carry units, and constants that have a unit by quantities.
"""

from __future__ import annotations

import contextlib
import importlib
import inspect
import itertools
import math
import pkgutil
import re
from collections.abc import Callable, Iterator
from types import ModuleType, SimpleNamespace
from typing import Any, get_type_hints

import pint
import pytest

import commonrail.physics.law
from commonrail.physics import flow, fuel_kernel
from commonrail.physics.components import (
    contact,
    control_chamber,
    direct_needle,
    drive,
    feed_pipe,
    needle_seat,
    nozzle,
    plunger_needle,
    return_line,
    rigid_body,
    solenoid,
    valve,
)
from commonrail.physics.law import describe

Law = Callable[..., Any]

REGISTRY: pint.UnitRegistry[Any] = pint.UnitRegistry()
LAWS = ("fuel", "fuel_kernel", "flow", "components")  # modules and packages whose laws state units
PLAIN = ("elementary", "equations", "law", "state_vector")  # computed with numbers
POWERS = {"²": "**2", "³": "**3", "⁴": "**4"}

# Constants with a unit, by name, in whichever modules use them.
CONSTANTS = {
    "_PER_100_MPA": "1/Pa",
    "RESIDUAL_LIFT": "m",
    "TINY_GAP": "m",
    "TINY_PATH": "m",
    "CATALOGUE_PRESSURE": "Pa",
    "ROUNDED": "m/s",
    "MU0": "T m/A",
    "TINY_CURRENT": "A",
    "TINY_GAIN": "A/V",
    "UNLIMITED": "V",
    "RELAXED": "Pa",
    "PER_RESIDUAL": "1/m",
    "PER_RELAXED": "1/Pa",
    "LEAST_DROP": "Pa",
}

# NamedTuples of one unit, which the docstring of each law gives.
UNIFORM = (plunger_needle.Nine, plunger_needle.Seven, direct_needle.Pair)

# Units of the fields, in order, of each NamedTuple that a law takes or returns. `Parameters` state theirs themselves.
FIELDS: dict[type, str] = {
    fuel_kernel.FuelCoefficients: "kg/m3, m3/kg" + 7 * ", Pa" + 4 * ", 1" + 6 * ", s/m2" + 3 * ", 1" + ", Pa",
    fuel_kernel.PressureAndStiffness: "Pa, Pa m3/kg",
    contact.Contact: "N, N s/m",
    contact.Overlap: "m, 1",
    flow.Restriction: "m4 Pa, m4",
    flow.Flow: "kg/s, kg/(s Pa)",
    flow.Guide: "m3, 1/Pa",
    valve.Film: "N s m2, m",
    flow.Jet: "kg/s, kg/s",
    flow.Contents: "kg, kg/m3, Pa, Pa m3/kg",
    control_chamber.Coefficients: "m3, m4, m4, kg/s, 1, m4, m4, kg/s",
    direct_needle.ArmatureCoefficients: "1/kg, m, m, N, N/m, N s/m, N/m, s/m",
    direct_needle.Coefficients: "1/kg, N, N/m, N s/m",
    direct_needle.Loads: "N, N",
    direct_needle.State: "m, m/s, N",
    direct_needle.Contacts: "of its own, of its own, of its own, of its own",
    drive.State: "1",
    drive.Schedule: "1, 1",
    drive.Rate: "V, V, 1/s",
    drive.Change: "V, 1",
    drive.Backward: "V, V",
    feed_pipe.State: "kg/s, kg/s",
    feed_pipe.Travelling: "Pa, Pa",
    feed_pipe.Coefficients: "Pa s/kg, kg/(s Pa), Pa s2/kg2, s",
    needle_seat.Coefficients: "m2, m, 1, kg/s, N/m, s/m",
    nozzle.State: "m, kg",
    nozzle.Coefficients: "m4, m4, kg/s, s, 1, m, m, 1/m, 1/m, of its own",
    nozzle.Shape: "1, m, 1/m",
    plunger_needle.Coefficients: "N/m, N s/m, 1/kg, s/kg, s2/kg, N/m, kg, of their own",
    plunger_needle.Guides: "m2, m2, m2, of their own, of their own, N, N/m, m, N/m, s/m, N s/m, N",
    plunger_needle.Loads: "N, N, N, N, N",
    plunger_needle.Motion: "m, m, m",
    plunger_needle.State: "m, m/s, m/s",
    feed_pipe.RailCoefficients: "m3, m4",
    return_line.Coefficients: "Pa s/kg, Pa/kg, kg/Pa, s",
    return_line.State: "Pa, kg",
    rigid_body.State: "m, m/s",
    solenoid.State: "Wb, Wb",
    solenoid.Circuit: "A, A/Wb, A",
    solenoid.Coefficients: "A/(Wb m), A/Wb, 1/Wb2, N/Wb2, m, ohm, 1, s",
    valve.State: "m, m/s",
    valve.Coefficients: "1/kg, m, N, N/m, N s/m, m2, m, N/m, s/m, 1, of their own, of their own",
}


def quantity(value: float, unit: str) -> Any:
    """Quantity of a unit as docstrings write it: ``Pa m³/kg``, ``kg/(s Pa)``, ``1``."""
    for sign, power in POWERS.items():
        unit = unit.replace(sign, power)
    unit = re.sub(r"(?<=[A-Za-z])(\d)", r"**\1", unit).replace(" ", "*")
    return REGISTRY.Quantity(value, "" if unit == "1" else unit)


def same_dimension(found: Any, unit: Any) -> bool:
    """Return whether a value has the dimension of a quantity; a bare zero has any."""
    if not hasattr(found, "units") and found == 0.0:
        return True
    return bool((found if hasattr(found, "dimensionality") else quantity(found, "1")).is_compatible_with(unit))


def si(value: Any) -> Any:
    """Plain SI numbers of quantities, in their NamedTuples."""
    if isinstance(value, tuple):
        parts = [si(each) for each in value]
        return type(value)._make(parts) if hasattr(value, "_make") else tuple(parts)
    return value.to_base_units().magnitude if hasattr(value, "to_base_units") else value


def with_units(kind: Any, values: tuple[float, ...]) -> Any:
    """NamedTuple of quantities from plain SI values."""
    units = FIELDS[kind].split(", ") if kind in FIELDS else [each.unit for each in describe(kind).values()]
    assert len(units) == len(kind._fields), f"{kind.__module__}.{kind.__qualname__}: one unit for each field"
    return kind._make(map(quantity, values, units))


# --- What pint does not do ------------------------------------------------------------------------------------------


def _root(x: Any) -> Any:
    return x**0.5 if hasattr(x, "units") else math.sqrt(x)


def _plain(function: Callable[[float], float]) -> Callable[[Any], float]:
    return lambda x: function(x.to("").magnitude if hasattr(x, "to") else x)


def _bound(choose: Callable[[Any, Any], Any], x: Any, limit: Any) -> Any:
    """min or max; a bare zero has the unit of the other, as it has for pint's own sums."""
    for one, other in ((x, limit), (limit, x)):
        if not hasattr(one, "units") and one == 0.0 and hasattr(other, "units"):
            return choose(other, REGISTRY.Quantity(0.0, other.units))
    return choose(x, limit)


def _literal_zero(add: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """Sum or difference in which a quantity of zero has any unit: what a law's bare 0.0 has become by a product."""

    def summed(one: Any, other: Any) -> Any:
        if hasattr(other, "units") and not one.is_compatible_with(other):
            if other.magnitude == 0.0:
                return one
            if one.magnitude == 0.0:
                return add(0.0 * other, other)
        return add(one, other)

    return summed


STAND_INS = {
    "min": lambda x, limit: _bound(min, x, limit),
    "max": lambda x, limit: _bound(max, x, limit),
    "math": SimpleNamespace(
        sqrt=_root, pi=math.pi, **{f: _plain(getattr(math, f)) for f in ("sin", "cos", "exp", "tanh")}
    ),
}


def physics_modules(names: tuple[str, ...] = ("",)) -> Iterator[ModuleType]:
    """Modules and packages of `commonrail.physics` by name, with all that is in them; "" for all."""
    for found in pkgutil.walk_packages(commonrail.physics.__path__, "commonrail.physics."):
        name = found.name.removeprefix("commonrail.physics.")
        if not found.ispkg and name not in PLAIN and any(name == n or not n or name.startswith(f"{n}.") for n in names):
            yield importlib.import_module(found.name)


@contextlib.contextmanager
def carried() -> Iterator[None]:
    """Let the plain functions of fuel, flow, parts and injector take quantities."""
    with pytest.MonkeyPatch.context() as patch:
        for module in physics_modules():
            for name, stand_in in STAND_INS.items():
                patch.setattr(module, name, stand_in, raising=False)
            for name in vars(module).keys() & CONSTANTS:
                patch.setattr(module, name, quantity(getattr(module, name), CONSTANTS[name]))
        for name in ("__add__", "__sub__"):
            patch.setattr(REGISTRY.Quantity, name, _literal_zero(getattr(REGISTRY.Quantity, name)))
        yield


# --- What a docstring states ----------------------------------------------------------------------------------------


def laws() -> dict[str, Law]:
    """Every `@physics` law of fuel, flow and parts by its dotted name, but for pieces without a name of their own."""
    modules = {module.__name__ for module in physics_modules(LAWS)}
    found = [law for law in commonrail.physics.law._LAWS if law.__module__ in modules and law.__doc__]
    return {f"{law.__module__.removeprefix('commonrail.physics.')}.{law.__name__}": law for law in found}


def documented(law: Law) -> dict[str, list[str]]:
    """Units of each parameter: those behind "`name`:" in the docstring; "as in `other`" leads to another law."""
    stated = {"dt": ["s"]}  # of every law
    for names, text in _stated(law):
        other = re.match(r"as in `(\w+)`", text)
        source = documented(getattr(inspect.getmodule(law), other[1])) if other else {}
        for name in names:
            stated[name] = source.get(name, []) if other else re.findall(r"\[([^\]]+)\]", text)
    as_a_whole = re.search(r"Arguments as in `(\w+)`", law.__doc__ or "")
    return documented(getattr(inspect.getmodule(law), as_a_whole[1])) if as_a_whole else stated


def _stated(law: Law) -> Iterator[tuple[list[str], str]]:
    """Names of parameters and the text behind each group of them, as in "`length`, `diameter`: L and D [m]"."""
    text = " ".join(inspect.cleandoc(law.__doc__ or "").split())
    heads = list(re.finditer(_HEAD, text))
    for head, following in itertools.zip_longest(heads, heads[1:]):
        yield re.findall(r"`(\w+)`", head[0]), text[head.end() : following.start() if following else None].strip()


_HEAD = r"`\w+`(?:, `\w+`)*(?: \([^)]*\))?:"


def returned(law: Law) -> list[str]:
    """Units in the docstring's first paragraph, before its parameters: of what the law returns, in order."""
    first = inspect.cleandoc(law.__doc__ or "").split("\n\n")[0]
    return re.findall(r"\[([^\]]+)\]", re.split(_HEAD, first)[0])


def check_returned(law: Law, found: Any) -> None:
    """Compare what a law returned with what it says it returns."""
    kind = get_type_hints(law)["return"]
    values = found if isinstance(found, tuple) and kind not in UNIFORM else (found,)
    units = returned(law)
    if kind in FIELDS and law.__name__ != "rates":  # which has the fields of a state, each per second
        units = FIELDS[kind].split(", ")
    assert len(units) == len(values), f"the first paragraph must give {len(values)} units, not {units}"
    for value, unit in zip(values, units, strict=True):
        check_value(value, unit)


def check_value(value: Any, unit: str) -> None:
    """Compare a value, or each of a NamedTuple, with the unit that is documented for it."""
    units = FIELDS[type(value)].split(", ") if type(value) in FIELDS else itertools.repeat(unit)
    if isinstance(value, tuple):
        for each, its_unit in zip(value, units, strict=False):
            check_value(each, its_unit)
    elif si(value) != 0.0:  # zero times any unit is a law's bare 0.0; other trials take the law's other branch
        assert same_dimension(value, quantity(1.0, unit)), f"{value} is returned, [{unit}] is documented"
