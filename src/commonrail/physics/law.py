"""Laws of the physics as plain functions, metadata of their parameters, and NamedTuples laid out in rows of an array.

`physics` marks every small scalar law and returns the plain Python function, so debuggers, coverage and dimensional
tests see ordinary code. Whatever compiles the laws (`commonrail.compiler.laws`, the CUDA kernels) receives them from
`offer_laws`; nothing here needs Numba. In all laws `dt` is the time step [s], `c` the coefficients and `s` the state.

An engine stores everything at one base pointer, so the compiler can prove that lanes do not overlap: a nested
NamedTuple of numbers lies in one column of a (rows × lanes) array. Physics never sees a row number: `Layout.load` gives
it the NamedTuple back by name.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator
from enum import Enum
from types import CellType, FunctionType
from typing import Any, NamedTuple, TypeVar, get_type_hints

import numpy as np

# Subnormal numbers are flushed to zero: each costs the processor a hundred cycles. They are frequent in f32, and in f64
# after motion has decayed.
FLUSH_TINY = np.int32(0x8040)
KEEP_ALL, KEEP_NONE = np.int32(-1), np.int32(0)
CACHE_LINE = 64  # [bytes]

_Law = TypeVar("_Law", bound=Callable[..., Any])
_LAWS: list[Callable[..., Any]] = []
_MACHINES: list[Callable[[Callable[..., Any]], None]] = []


def physics(law: _Law) -> _Law:
    """Mark a scalar law that kernels may inline; for Python it stays a plain function."""
    _LAWS.append(law)
    for offer in _MACHINES:
        offer(law)
    return law


def offer_laws(offer: Callable[[Callable[..., Any]], None]) -> None:
    """Offer all laws, present and later, to a further kind of machine.

    `offer` (function (law) -> None): called with every law.
    """
    _MACHINES.append(offer)
    for law in _LAWS:
        offer(law)


def _single(value: Any) -> Any:
    """A constant, or the constants in a tuple, in single precision."""
    if isinstance(value, tuple):
        parts = map(_single, value)
        return value._make(parts) if hasattr(value, "_make") else tuple(parts)
    return np.float32(value) if type(value) is float else value


@functools.cache
def in_single(law: Callable[..., Any]) -> Callable[..., Any]:
    """The same law with its constants in single precision."""

    code = law.__code__.replace(co_consts=tuple(map(_single, law.__code__.co_consts)))
    names = {name: _single(law.__globals__[name]) for name in code.co_names if name in law.__globals__}
    names["__name__"] = law.__module__
    cells = tuple(CellType(_single(cell.cell_contents)) for cell in law.__closure__ or ())
    twin = FunctionType(code, names, law.__name__, law.__defaults__, cells)
    twin.__module__, twin.__qualname__ = law.__module__, law.__qualname__
    return twin


# The functions that read and write a NamedTuple are generated from it, as plain straight-line Python, when they are
# first asked for.

Choices = tuple[tuple[str, type], ...]

# One running index: Numba takes milliseconds for each operation in a text, and there are hundreds of rows.
_ON = "    i += stride"


class Layout:
    """Rows of the fields of a nested NamedTuple.

    Parameters
    ----------
    kind, choices
        Arguments of `layout_of`.

    Attributes
    ----------
    paths : tuple of str
        Dotted field names in row order: ``plunger_needle.k1``.
    """

    def __init__(self, kind: type, choices: Choices = ()) -> None:
        self.paths = tuple(field_paths(kind, choices))
        self._kind, self._choices = kind, choices

    @functools.cached_property
    def load(self) -> Callable[..., Any]:
        """Function (array, start, stride) -> NamedTuple that reads the fields from index `start` on, `stride` apart."""
        names: dict[str, Any] = {}
        constructor = _constructor(self._kind, self._choices, names, iter(range(10_000)))
        reads = [line for row, _ in enumerate(self.paths) for line in (f"    r{row} = a[i]", _ON)]
        return self._law("load(a, start, stride)", [*reads[:-1], f"    return {constructor}"], names)

    @functools.cached_property
    def store(self) -> Callable[..., Any]:
        """Function (array, start, stride, value) -> None that writes them."""
        values = (".".join(filter(None, ("value", path))) for path in self.paths)
        writes = [line for value in values for line in (f"    a[i] = {value}", _ON)]
        return self._law("store(a, start, stride, value)", writes[:-1], {})

    def row(self, path: str) -> int:
        """Row of a dotted field name, the first one of a group of fields."""
        return next(i for i, row_path in enumerate(self.paths) if f"{row_path}.".startswith(f"{path}."))

    def _law(self, head: str, lines: list[str], names: dict[str, Any]) -> Callable[..., Any]:
        """Law generated from text.

        `head`: name and arguments; `names`: types that the lines name.
        """
        names["__name__"] = __name__
        text = "\n".join([f"def {head}:", "    i = start", *lines, ""])
        exec(compile(text, f"<layout of {self._kind.__qualname__}>", "exec"), names)
        law: Callable[..., Any] = physics(names[head.partition("(")[0]])
        return law


def field_paths(kind: type, choices: Choices = (), prefix: str = "") -> Iterator[str]:
    """Dotted names of the float fields of a nested NamedTuple.

    `kind`: NamedTuple, or float itself; `choices` (tuple of (field name, type)): types of the fields annotated ``Any``;
    `prefix`: in front of each name.
    """
    if kind is float:
        yield prefix
    else:
        for name, hint in _fields(kind, choices):
            yield from field_paths(hint, choices, f"{prefix}.{name}" if prefix else name)


@functools.cache
def _fields(kind: type, choices: Choices) -> tuple[tuple[str, type], ...]:
    hints, chosen_types = get_type_hints(kind), dict(choices)
    names = kind._fields  # type: ignore[attr-defined]
    return tuple((name, chosen_types.get(name, hints[name]) if hints[name] is Any else hints[name]) for name in names)


@functools.cache
def layout_of(kind: type, choices: Choices = ()) -> Layout:
    """Layout of a nested NamedTuple type, one for all who ask.

    `kind`: A NamedTuple whose fields are float or such NamedTuples, or float itself; `choices` (tuple of (field name,
    type)): types of the fields annotated ``Any``, such as ``(("body", rigid_body.State),)``.
    """
    return Layout(kind, choices)


def _constructor(kind: type, choices: Choices, names: dict[str, Any], rows: Iterator[int]) -> str:
    if kind is float:
        return f"r{next(rows)}"
    alias = f"T{len(names)}"
    names[alias] = kind
    parts = [_constructor(hint, choices, names, rows) for _, hint in _fields(kind, choices)]
    return f"{alias}({', '.join(parts)})"


# Metadata of parameters: unit, meaning, domain, usual range.


class Domain(Enum):
    """Values that make physical sense for a parameter."""

    POSITIVE = "greater than zero"
    NON_NEGATIVE = "zero or greater"
    UNIT = "between 0 and 1"
    COEFFICIENT = "greater than zero and at most 1"
    CHANGE = "greater than -1"
    CONE = "greater than zero and less than pi rad (180 deg)"
    ANY = "any finite number"

    def admits(self, value: Any) -> Any:
        """Return whether `value` (SI, a number or an array) lies in the domain; NaN never does."""
        if self is Domain.POSITIVE:
            return value > 0.0
        if self is Domain.NON_NEGATIVE:
            return value >= 0.0
        if self is Domain.UNIT:
            return (value >= 0.0) & (value <= 1.0)
        if self is Domain.COEFFICIENT:
            return (value > 0.0) & (value <= 1.0)
        if self is Domain.CHANGE:
            return value > -1.0
        if self is Domain.CONE:
            return (value > 0.0) & (value < math.pi)
        return value == value


class Q(NamedTuple):
    """Metadata of a parameter.

    Attributes
    ----------
    unit, meaning : str
        SI unit, and the quantity.
    domain : Domain
        Values outside are refused.
    default : float or None
        [SI]; None: must be given.
    usual : (low, high) or None
        Range of built injectors [SI]; a value outside is used, and reported as implausible. Zero, where the domain
        holds it, switches the effect off and is never outside.
    """

    unit: str
    meaning: str
    domain: Domain = Domain.POSITIVE
    default: float | None = None
    # Engineering estimates, from passenger-car to heavy-duty injectors with a factor of about 3 to spare: wide enough
    # for any of them, narrow enough that a unit mistaken by 10³ falls outside (a test holds the catalogue to that).
    usual: tuple[float, float] | None = None

    def is_usual(self, value: float, slack: float = 1.0) -> bool:
        """Return whether `value` [SI] lies in the usual range, widened by the factor `slack` at both ends."""
        if self.usual is None or (value == 0.0 and self.domain is Domain.NON_NEGATIVE):
            return True
        low, high = self.usual
        return (low / slack if low > 0.0 else low * slack) <= value <= high * slack


@functools.cache
def describe(parameters: type) -> dict[str, Q]:
    """Name → `Q` of the fields of a ``Parameters`` NamedTuple whose fields are ``Annotated[float, Q]``."""
    hints: dict[str, Any] = get_type_hints(parameters, include_extras=True)
    return {name: hint.__metadata__[0] for name, hint in hints.items()}
