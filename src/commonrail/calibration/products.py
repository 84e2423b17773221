"""Constraints between products of parameters, such as a preload that holds a valve shut against the pressure."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from commonrail.arrays import Floats
from commonrail.calibration.constraints import STRICT_MARGIN
from commonrail.errors import InputError, nearest

__all__ = ["ProductConstraint", "Products", "parse_products"]


_RELATION = re.compile(r"<=|>=|<|>")
_FACTOR = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<name>[A-Za-z_]\w*(?:\.\w+)*))"
    r"\s*(?:\^\s*(?P<power>-?\d+(?:\.\d+)?))?\s*$"
)


class ProductConstraint(NamedTuple):
    """Constraint factor · Π x_j^exponent_j >= 1.

    Attributes
    ----------
    label : str
        The text that a person wrote.
    factor : float
        Numbers and values that do not vary.
    exponents : (d,)
        One for each free parameter.
    strict : bool
        The product must exceed 1 by `STRICT_MARGIN`.
    """

    label: str
    factor: float
    exponents: Floats
    strict: bool


class Products:
    """Constraints between products of parameters.

    Parameters
    ----------
    constraints : sequence of ProductConstraint
    """

    def __init__(self, constraints: Sequence[ProductConstraint] = ()) -> None:
        self.constraints = tuple(constraints)

    def __len__(self) -> int:
        return len(self.constraints)

    @property
    def labels(self) -> tuple[str, ...]:
        """The texts that a person wrote."""
        return tuple(constraint.label for constraint in self.constraints)

    def shortfall(self, x: Floats) -> Floats:
        """Share (..., m) by which each product at points (..., d) lies below 1; 0 where the constraint holds."""
        found = np.zeros((*x.shape[:-1], len(self)))
        for column, c in enumerate(self.constraints):
            used = np.flatnonzero(c.exponents)
            with np.errstate(all="ignore"):
                ratio = c.factor * np.prod(x[..., used] ** c.exponents[used], axis=-1)
            needed = 1.0 + STRICT_MARGIN if c.strict else 1.0
            short = np.maximum(0.0, 1.0 - ratio / needed)
            found[..., column] = np.where(np.isnan(short), 1.0, short)
        return found


NONE = Products()


def parse_products(lines: Sequence[str], names: Sequence[str], known: Mapping[str, float]) -> Products:
    """Read constraints such as ``"valve.spring_preload >= 1.2 * pi / 4 * valve.seat_diameter^2 * rail_pressure_max"``.

    Each side is a product or quotient of numbers (SI), parameters and powers of them. ``pi`` is known.

    Parameters
    ----------
    lines : sequence of str
        One relation each.
    names : sequence of str
        The free parameters, in the order of the columns.
    known : mapping of str to float
        Values [SI] of names that do not vary.

    Raises
    ------
    InputError
        If a text cannot be read, names something unknown or holds no free parameter.
    """
    return Products([_read(line.strip(), names, {"pi": math.pi, **known}) for line in lines])


def _read(line: str, names: Sequence[str], known: Mapping[str, float]) -> ProductConstraint:
    sides, relations = _RELATION.split(line), _RELATION.findall(line)
    if len(relations) != 1:
        raise _unreadable(line, 'needs exactly one of "<", "<=", ">" and ">="')
    (left, right), relation = sides, relations[0]
    small, large = (left, right) if relation.startswith("<") else (right, left)
    factors, exponents = zip(*(_product(line, side, names, known) for side in (large, small)), strict=True)
    total = exponents[0] - exponents[1]
    if not total.any():
        raise _unreadable(line, "depends on no free parameter")
    if not (0.0 < factors[0] < math.inf and 0.0 < factors[1] < math.inf):
        raise _unreadable(line, "has a factor that is not greater than zero, or too large")
    return ProductConstraint(line, factors[0] / factors[1], total, "=" not in relation)


def _product(line: str, side: str, names: Sequence[str], known: Mapping[str, float]) -> tuple[float, Floats]:
    """Factor and exponents of one side."""
    factor, exponents = 1.0, np.zeros(len(names))
    pieces = ["*", *re.split(r"([*/])", side)]
    for sign, text in zip(pieces[::2], pieces[1::2], strict=True):
        match = _FACTOR.match(text)
        if match is None:
            found = f'"{text.strip()}"' if text.strip() else "nothing"
            raise _unreadable(line, f"has {found} where a number, a parameter or a power of one is expected")
        power = float(match["power"] or 1.0) * (1.0 if sign == "*" else -1.0)
        if match["number"]:
            factor *= _power(float(match["number"]), power)
        elif match["name"] in names:
            exponents[list(names).index(match["name"])] += power
        elif match["name"] in known:
            factor *= _power(known[match["name"]], power)
        else:
            close = nearest(match["name"], [*names, *known])
            raise InputError(f'constraint "{line}" names "{match["name"]}", which is no parameter{close}')
    return factor, exponents


def _power(value: float, power: float) -> float:
    """Power of a number; NaN of one that is not greater than zero, infinite if it is too large."""
    with np.errstate(over="ignore", under="ignore"):
        return float(np.float64(value) ** power) if value > 0.0 else math.nan


def _unreadable(line: str, what: str) -> InputError:
    return InputError(
        f'constraint "{line}" {what}: write one relation between products, such as '
        '"valve.spring_preload >= 1.2 * pi / 4 * valve.seat_diameter^2 * rail_pressure_max"'
    )
