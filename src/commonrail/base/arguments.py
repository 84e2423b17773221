"""Arguments of the public functions: read here, or refused with a sentence that names the argument and the cure.

A number may be text with its unit wherever one is expected; NumPy's numbers and arrays count as Python's. Everything
that cannot be used raises `ConfigurationError`, never an error from inside.
"""

from __future__ import annotations

import math
import os
import reprlib
from collections.abc import Callable, Collection, Mapping, Sequence
from enum import Enum
from numbers import Real
from pathlib import Path
from types import UnionType
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn, TypeVar, get_args, overload

from commonrail.base.errors import ConfigurationError, InputError, nearest
from commonrail.base.units import FAST, NAMES, parse, to_text

if TYPE_CHECKING:  # NumPy is imported when an array is read: the help of the command needs none
    from commonrail.base.arrays import Floats

Quantity = float | str  # an SI number, or text with its unit

MOST_THREADS = 1024
COUNTS = ("nozzle.holes", "solenoid.air_gaps")  # parameters that count pieces; a coil may have half a turn
LARGEST_WHOLE = 2**63 - 1  # what a study file and the journal can hold

_Kind = TypeVar("_Kind")
_Choice = TypeVar("_Choice", bound=Enum)


class Cure(NamedTuple):
    """Way to get an object of a class, for the error if a value of another kind is given.

    A class has its own as the class attribute `cure`. `text` may have {} for the path or name that was given in place
    of the object, or else for `example`.
    """

    text: str
    example: str = ""


# Of the classes that know nothing of arguments, by name.
_CURES = {
    "Study": Cure("read it with commonrail.load_study({})", "study.toml"),
    "Injector": Cure("read it with commonrail.load_injector({})", "virtual-lino-2016"),
    "Fuel": Cure("read it with commonrail.load_fuel({})", "iso4113"),
    "OperatingPoint": Cure('write commonrail.OperatingPoint("160 MPa", "700 us")'),
    "Parameter": Cure("commonrail.design.parameters_within(injector, [{}]) makes them", "valve.lift"),
    "Trace": Cure("write commonrail.Trace(times, values) with times [s] and SI values"),
    "Calibration": Cure("take what commonrail.calibrate returns"),
    "Solution": Cure("take what commonrail.simulate returns"),
    "Variant": Cure("write commonrail.Variant(body, boundary, drive)"),
}


class Limits(NamedTuple):
    """Smallest and largest value that is accepted, both in SI, and what a number beyond them was probably meant to be.

    Attributes
    ----------
    low, high : float
    likely : (float, float)
        Range of everyday values.
    units : sequence of str
        Units that people say the quantity in: the first in which a number lies in the likely range is proposed.
    """

    low: float
    high: float
    likely: tuple[float, float] = (1.0, 0.0)
    units: Sequence[str] = ()


TIME_STEPS = Limits(1e-9, 1e-4, (50e-9, 10e-6), ("us", "ns"))  # [s], of the fast engines


def number(value: object, unit: str, what: str) -> float:
    """Read one finite number.

    `value` is an SI number of Python or NumPy, or text with its unit; `unit` is the SI unit of the result, `what` the
    name of the argument in words. Raises `ConfigurationError` if it is not a finite number of this kind.

    Examples
    --------
    >>> number("160 MPa", "Pa", "rail pressure"), number(160e6, "Pa", "rail pressure")
    (160000000.0, 160000000.0)
    """
    if isinstance(value, str):
        try:
            return parse(value, unit, what)
        except InputError as error:
            raise ConfigurationError(f"{error}", code=error.code, place=what) from error
    result = _real(value)
    if result is None:
        raise _refusal(what, _describe_number(unit), value)
    if not math.isfinite(result):
        raise _refusal(what, f"finite, {_describe_number(unit)}", value)
    return result


def fraction(value: object, what: str) -> float:
    """Read one number between 0 and 1, ends excluded; `ConfigurationError` as `number`, or if outside."""
    share = number(value, "1", what)
    if not 0.0 < share < 1.0:
        is_plain = not isinstance(value, str) or value.strip()[-1:].isdigit()
        example = share if is_plain and 1.0 <= share < 100.0 else 50.0  # a number of percent without its sign
        read = " ".join(value.split()) if isinstance(value, str) else f"{share:g}"
        raise ConfigurationError(
            f"The {what} must lie between 0 and 100 %, both excluded, such as {example:g}%, not {read}.",
            code="out-of-range",
            place=what,
        )
    return share


def amount(value: object, unit: str, what: str, limits: Limits) -> float:
    """Read one number between two limits, both included.

    Raises `ConfigurationError` as `number`, and beyond the limits (in `unit`), with the value read and the unit that
    was probably meant.
    """
    quantity = number(value, unit, what)
    if limits.low <= quantity <= limits.high:
        return quantity
    low, high = to_text(limits.low, unit), to_text(limits.high, unit)
    # a number in SI units is repeated as it was written, a tiny or large one with a prefix
    plain = 1e-4 <= abs(quantity) < 1e6
    read = f"{quantity:.6g} {unit.removesuffix('1')}".rstrip() if plain else to_text(quantity, unit)
    raise ConfigurationError(
        f"The {what} must lie between {low} and {high}, and {read} was read{_meant(quantity, limits)}.",
        code="out-of-range",
        place=what,
    )


def positive(unit: str) -> Callable[[object, str], float]:
    """Reader of one number greater than zero, called with value and name; `ConfigurationError` as `number`."""

    def read(value: object, what: str) -> float:
        quantity = number(value, unit, what)
        if not quantity > 0.0:
            raise ConfigurationError(
                f"The {what} must be greater than zero, not {quantity:g}.", code="out-of-range", place=what
            )
        return quantity

    return read


def _meant(quantity: float, limits: Limits) -> str:
    """Proposal of the unit in which a plain number was probably meant."""
    low, high = limits.likely
    unit = next((unit for unit in limits.units if low <= quantity * FAST[unit].factor <= high), "")
    return f'; if {quantity:.6g} {unit} is meant, write "{quantity:.6g} {unit}"' if unit else ""


def array(value: object, unit: str, what: str, dimensions: int | None = None, finite: bool = True) -> Floats:
    """Read numbers of any shape.

    The value holds SI numbers or texts with their units, mixed as they come; `dimensions` is the number that it
    must have, and `finite` refuses not-a-number and infinity. Raises `ConfigurationError` if an element is no
    number, rows are of different lengths, or the number of dimensions is another.
    """
    import numpy as np

    values = _numeric(value, unit, what)
    if dimensions is not None and values.ndim != dimensions:
        raise ConfigurationError(
            f"The {what} must have {dimensions} dimension{'s' * (dimensions > 1)}, not the {values.ndim} of shape "
            f"{values.shape}.",
            code="wrong-shape",
            place=what,
        )
    if finite and not np.isfinite(values).all():
        where = int(np.flatnonzero(~np.isfinite(values.ravel()))[0]) + 1
        raise ConfigurationError(
            f"The {what} must be finite, and number {where} of them is not; correct or remove it.",
            code="not-finite",
            place=what,
        )
    return values


def _numeric(value: object, unit: str, what: str) -> Floats:
    import numpy as np

    if isinstance(value, str):
        return np.asarray(number(value, unit, what))
    try:
        raw = np.asarray(value)
        if raw.dtype.kind not in "iuf":
            raw = np.asarray(value, dtype=object)
    except Exception as error:  # rows of different lengths; whatever an object answers when asked for its array
        raise ConfigurationError(
            f"The {what} must be numbers in rows of one length ({error}).", code="wrong-shape", place=what
        ) from error
    if raw.dtype.kind in "iuf":
        return np.asarray(raw, dtype=np.float64)
    return np.reshape([_element(item, unit, what) for item in raw.ravel()], raw.shape).astype(np.float64)


def _element(item: object, unit: str, what: str) -> float:
    real = None if isinstance(item, str) else _real(item)
    return number(item, unit, what) if real is None else real


def integer(value: object, what: str, low: int = 0, high: int = LARGEST_WHOLE) -> int:
    """Read a whole number.

    `low` and `high`: limits, both included. Raises `ConfigurationError` if it is no number, has a fraction, or lies
    beyond the limits.
    """
    real = _real(value)
    if real is not None and math.isfinite(real) and real == math.floor(real):
        exact = int(value) if isinstance(value, int) else int(real)
        if low <= exact <= high:
            return exact
    if high == LARGEST_WHOLE:
        raise _refusal(what, f"a whole number, {low} or greater", value)
    raise ConfigurationError(
        f"The {what} must lie between {low} and {high} as a whole number, not {shown(value)}.",
        code="out-of-range",
        place=what,
    )


def not_whole(name: str, value: float) -> str:
    """Sentence on a fractional value of a count; empty for everything else."""
    if name not in COUNTS or value % 1.0 == 0.0:
        return ""
    return f"{name} counts pieces and must be a whole number, not {value:g}"


def thread_count(threads: object) -> int | None:
    """Read a number of threads; None stands for all usable processors."""
    return None if threads is None else integer(threads, "number of threads", 1, MOST_THREADS)


def flag(value: object, what: str) -> bool:
    """Read True or False."""
    value = _plain(value)
    if not isinstance(value, bool):
        raise _refusal(what, "True or False", value)
    return value


def enum_member(value: object, kind: type[_Choice], what: str) -> _Choice:
    """Read a member of an enum, or its value.

    Raises `ConfigurationError` with all values, and the nearest one to an unknown text.
    """
    if isinstance(value, kind):
        return value
    members = {str(member.value): member for member in kind}
    if isinstance(value, str) and value in members:
        return members[value]
    meant = nearest(value, members) if isinstance(value, str) else ""
    *others, last = (f'"{name}"' for name in members)
    raise ConfigurationError(
        f"The {what} must be {', '.join(others)} or {last}, not {shown(value)}{meant}.", code="unknown-name", place=what
    )


def plain_text(value: object, what: str) -> str:
    """Read a text."""
    if not isinstance(value, str):
        raise _refusal(what, "a text", value)
    return value


def function(value: _Kind | None, what: str) -> _Kind | None:
    """Return a function or None, refuse anything else."""
    if value is not None and not callable(value):
        raise _refusal(what, "a function or None", value)
    return value


def file_path(value: object, what: str) -> Path:
    """Read the path of a file or folder.

    Raises `ConfigurationError` if it is neither a text nor a path, is empty, or no system can have it.
    """
    if not isinstance(value, str | os.PathLike) or isinstance(path := os.fspath(value), bytes):
        raise _refusal(what, "a path as text or as pathlib.Path", value)
    if not path or "\0" in path:
        raise _refusal(what, "a path that is not empty and has no null character", value)
    return Path(path)


def read_source(value: object, what: str) -> str | Path:
    """Read a name of the catalogue as text, or the path of a .toml file as Path."""
    return value if isinstance(value, str) and not value.endswith(".toml") else file_path(value, what)


@overload
def instance(value: object, kind: type[_Kind], what: str) -> _Kind: ...
@overload
def instance(value: object, kind: UnionType, what: str) -> Any: ...
def instance(value: object, kind: Any, what: str) -> Any:
    """Return a value of a kind, or of one of several; refuse others with the way to get one.

    Raises `ConfigurationError` with the cure, such as ``commonrail.load_study("study.toml")`` where a path was given
    for a study.
    """
    if isinstance(value, kind):
        return value
    kinds = get_args(kind) or (kind,)
    names = [accepted.__name__ for accepted in kinds]
    cure, words = getattr(kinds[0], "cure", None) or _CURES.get(names[0]), ""
    if isinstance(cure, Cure):
        source = f"{value}" if isinstance(value, str | os.PathLike) else cure.example
        words = f"; {cure.text.format(_quote(source))}"
    article = "an" if names[0][0] in "AEIOU" else "a"
    raise ConfigurationError(
        f"The {what} must be {article} {' or '.join(names)}, not {shown(value)}{words}.", code="wrong-type", place=what
    )


def sequence(value: object, what: str, of: str) -> Sequence[Any]:
    """Return a list, tuple or array; refuse others, texts included.

    `of`: what the list holds, as it is written: ``"[point]"``.
    """
    import numpy as np

    if isinstance(value, np.ndarray) and value.ndim:
        return list(value)
    if not isinstance(value, Sequence) or isinstance(value, str | bytes):
        raise _refusal(what, f"a list, such as {of}", value)
    return value


@overload
def instances(value: object, kind: type[_Kind], what: str) -> tuple[_Kind, ...]: ...
@overload
def instances(value: object, kind: UnionType, what: str) -> tuple[Any, ...]: ...
def instances(value: object, kind: Any, what: str) -> tuple[Any, ...]:
    """Read a list whose items are all of a kind.

    Raises `ConfigurationError` if it is not a list, or for the first item of another kind.
    """
    items = sequence(value, what, f"[{(get_args(kind) or (kind,))[0].__name__}(…), …]")
    return tuple(instance(item, kind, f"item {i} of the {what}") for i, item in enumerate(items, start=1))


def mapping(value: object, what: str, example: str) -> Mapping[str, Any]:
    """Return a mapping with texts as keys, refuse anything else."""
    if not isinstance(value, Mapping):
        raise _refusal(what, f"a mapping, such as {example}", value)
    for key in value:
        if not isinstance(key, str):
            raise ConfigurationError(
                f"The {what} must have texts as keys, such as {example}, and {shown(key)} is none.",
                code="wrong-type",
                place=what,
            )
    return value


def known_names(value: object, accepted: Collection[str], what: str, example: str) -> tuple[str, ...]:
    """Read a list of names, each one known and listed once.

    Raises `ConfigurationError` with the first name that is unknown, and the nearest that is known, or that is repeated.
    """
    names = sequence(value, what, f'["{example}"]')
    for i, name in enumerate(names):
        if not isinstance(name, str) or name not in accepted:
            meant = nearest(name, accepted) if isinstance(name, str) else f", such as {example}"
            raise ConfigurationError(
                f"The {what} must be known ones, and {shown(name)} is none{meant}.", code="unknown-name", place=what
            )
        if name in names[:i]:
            raise ConfigurationError(
                f"The {what} have {name} more than once; keep one of them.", code="repeated", place=what
            )
    return tuple(map(str, names))


class FrozenDict(dict[Any, Any]):
    """Dict that cannot be changed; it has a hash if its values have one."""

    def __hash__(self) -> int:  # type: ignore[override]
        return hash(frozenset(self.items()))

    def __reduce__(self) -> tuple[Any, ...]:
        return FrozenDict, (dict(self),)

    def _refuse(self, *_: object, **__: object) -> NoReturn:
        raise TypeError("These values belong to a frozen object; make another one, as dataclasses.replace does.")

    __setitem__ = __delitem__ = __ior__ = clear = pop = popitem = setdefault = update = _refuse


def settle(target: object, **values: object) -> None:
    """Set attributes of a frozen dataclass to the values read from its arguments, as `frozen` returns them."""
    for name, value in values.items():
        object.__setattr__(target, name, frozen(value))


def frozen(value: Any) -> Any:
    """Return a value whose mappings, lists and arrays are replaced by ones that cannot be changed."""
    import numpy as np

    if isinstance(value, np.ndarray) and value.flags.writeable:
        value = value.copy()
        value.flags.writeable = False
    elif isinstance(value, Mapping) and not isinstance(value, FrozenDict):
        return FrozenDict({key: frozen(item) for key, item in value.items()})
    return tuple(map(frozen, value)) if isinstance(value, list) else value


def shown(value: object) -> str:
    """One short line for any object."""
    value = _plain(value)
    if isinstance(value, str):
        return _quote(value)
    line = " ".join(reprlib.repr(value).split())
    return line if len(line) <= 60 else f"{line[:57]}..."


def _plain(value: Any) -> Any:
    """Python's value of a NumPy scalar or of an array without dimensions; any other value as it is."""
    return value.item() if isinstance(getattr(value, "ndim", None), int) and value.ndim == 0 else value


def _real(value: object) -> float | None:
    """Float of a real number, None for anything else, also for True and False."""
    if type(value) is float:
        return value
    value = _plain(value)
    if isinstance(value, bool) or not isinstance(value, Real):
        return None
    try:
        return float(value)
    except OverflowError:  # an integer of more than 308 digits
        return math.inf


def _describe_number(unit: str) -> str:
    if unit == "1":
        return "a plain number, such as 0.8"
    name, example = NAMES.get(unit, (f"a quantity in {unit}", f"3 {unit}"))
    return f'{name} as a number in {unit} or as text with its unit, such as "{example}"'


def _quote(text: str) -> str:
    line = " ".join(text.split())
    return f'"{line if len(line) <= 120 else line[:117] + "..."}"'


def _refusal(what: str, expected: str, value: object) -> ConfigurationError:
    return ConfigurationError(f"The {what} must be {expected}, not {shown(value)}.", code="wrong-type", place=what)
