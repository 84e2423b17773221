"""Linear constraints between parameters, and whether they leave room within the bounds."""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from commonrail.base.arguments import settle
from commonrail.base.arrays import Bools, Floats
from commonrail.base.errors import ConfigurationError, InputError, nearest
from commonrail.physics.elementary import product

# Tolerance for rounding in a row, and margin of a strict row (<); both relative to the largest
# magnitude of the row's terms within the bounds. The margin is much larger than the tolerance, so an
# accepted strict row is also strict in floating point.
ROUNDING = 1e-12
STRICT_MARGIN = 1e-9
# A polytope whose largest inscribed ball is smaller than this (bounds scaled to 1) has no room:
# far above the rounding of the linear programme that finds the ball.
LEAST_RADIUS = 1e-6


@dataclass(frozen=True, eq=False)
class LinearConstraints:
    """Constraints ``matrix @ x >= lower`` on the free parameters, one row each.

    Raises `ConfigurationError` if shapes disagree, a number is not finite or a row has no coefficient.
    """

    matrix: Floats  # (m, d), coefficients, one column for each parameter of the space, in SI units
    lower: Floats  # (m,), least value of each row
    # (m,) of bool, rows meant as ``>``: they must exceed ``lower`` by `STRICT_MARGIN` of the row's largest magnitude.
    # Every row is forgiven `ROUNDING` of the same magnitude
    strict: Bools | None = None
    labels: Sequence[str] = ()  # the text a person wrote for each row, for messages
    # orderings as columns in ascending order, e.g. ``(6, 1, 2)`` for ``k7 < k2 < k3``; repair sorts the values along
    # them
    chains: Sequence[Sequence[int]] = ()

    def __post_init__(self) -> None:
        matrix = np.atleast_2d(np.array(self.matrix, dtype=float))
        lower = np.atleast_1d(np.array(self.lower, dtype=float))
        strict = np.zeros(len(lower), bool) if self.strict is None else np.array(self.strict, bool)
        labels = tuple(self.labels) or tuple(f"row {row + 1}" for row in range(len(lower)))
        _check_rows(matrix, lower, strict, labels)
        chains = tuple(tuple(chain) for chain in self.chains)
        settle(self, matrix=matrix, lower=lower, strict=strict, labels=labels, chains=chains)

    @classmethod
    def none(cls, dimension: int) -> LinearConstraints:
        """No constraint at all on `dimension` parameters."""
        return cls(np.zeros((0, dimension)), np.zeros(0))

    @property
    def dimension(self) -> int:
        """Number of parameters (columns)."""
        return int(self.matrix.shape[1])

    def __len__(self) -> int:
        return len(self.lower)

    def magnitude(self, lower: Floats, upper: Floats) -> Floats:
        """Largest magnitude (m,) that each row's terms take within the bounds, for tolerances."""
        largest = np.maximum(np.abs(lower), np.abs(upper))
        return product(largest, np.abs(self.matrix).T) + np.abs(self.lower)

    def floor(self, lower: Floats, upper: Floats) -> Floats:
        """Least value (m,) of each row with the margin of the strict rows added."""
        margin = STRICT_MARGIN * self.magnitude(lower, upper)
        return np.asarray(self.lower + np.where(self.strict_rows, margin, 0.0))

    @functools.cached_property
    def strict_rows(self) -> Bools:
        """Mask of the strict rows (m,)."""
        return np.asarray(self.strict, dtype=bool)


def _check_rows(matrix: Floats, lower: Floats, strict: Bools, labels: tuple[str, ...]) -> None:
    """Refuse rows that cannot be constraints."""
    rows = len(lower)
    if matrix.ndim != 2 or not len(matrix) == rows == len(strict) == len(labels):
        raise ConfigurationError(
            f"constraints: {len(matrix)} rows of coefficients, {rows} lower limits, {len(strict)} "
            f"strictness flags and {len(labels)} labels were given, expected as many of each"
        )
    if not (np.isfinite(matrix).all() and np.isfinite(lower).all()):
        raise ConfigurationError("constraints: every coefficient and limit must be a finite number")
    if rows and not matrix.any(axis=1).all():
        row = int(np.argmin(matrix.any(axis=1)))
        raise ConfigurationError(
            f'constraint "{labels[row]}" depends on no free parameter: correct it or remove it',
            code="no-free-parameter",
        )


class Polytope(NamedTuple):
    """Bounds and constraints as ``rows @ z >= floor`` with z = (x - lower)/(upper - lower).

    Rows have unit length; the 2 d rows of the bounds, 0 <= z <= 1, come last.
    """

    rows: Floats
    floor: Floats

    @classmethod
    def of(cls, constraints: LinearConstraints, lower: Floats, upper: Floats) -> Polytope:
        """Scale constraints to the bounds (d,), (d,) and append the bounds as rows."""
        rows = constraints.matrix * (upper - lower)
        floor = constraints.floor(lower, upper) - product(lower, constraints.matrix.T)
        length = np.linalg.norm(rows, axis=1)
        box = np.eye(len(lower))
        return cls(
            np.vstack([rows / length[:, None], box, -box]),
            np.concatenate([floor / length, np.zeros(len(lower)), -np.ones(len(lower))]),
        )


def deepest_point(polytope: Polytope) -> tuple[Floats, float]:
    """Centre (d,) and radius of the largest ball inside the polytope (its Chebyshev centre).

    A radius below `LEAST_RADIUS` (or negative) means that the polytope has no room.
    """
    centre, radius = _deepest_point(polytope.rows.tobytes(), polytope.floor.tobytes())
    return centre.copy(), radius


@functools.lru_cache(maxsize=8)  # a space first asks whether it has room, and later for the point
def _deepest_point(row_bytes: bytes, floor_bytes: bytes) -> tuple[Floats, float]:
    from scipy.optimize import linprog  # slow to import, and a study without constraints does without

    floor = np.frombuffer(floor_bytes)
    rows = np.frombuffer(row_bytes).reshape(len(floor), -1)
    dimension = rows.shape[1]
    # Unknowns z and r: greatest r with rows @ z - r >= floor; there always is one, and the bounds limit it.
    inequality = np.hstack([rows, -np.ones((len(rows), 1))])
    downwards = -np.append(np.zeros(dimension), 1.0)
    point: Floats = linprog(downwards, A_ub=-inequality, b_ub=-floor, bounds=(None, None)).x
    return point[:dimension], float(point[dimension])


def conflicting_rows(constraints: LinearConstraints, lower: ArrayLike, upper: ArrayLike) -> tuple[int, ...]:
    """Rows that cannot hold together within the bounds; empty if all can.

    The set is irreducible: dropping any one of its rows leaves room (deletion filter).
    """
    low, high = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    polytope = Polytope.of(constraints, low, high)
    bounds = list(range(len(constraints), len(polytope.rows)))

    def roomy(rows: list[int]) -> bool:
        with_bounds = rows + bounds
        return deepest_point(Polytope(polytope.rows[with_bounds], polytope.floor[with_bounds]))[1] > (LEAST_RADIUS)

    conflict = list(range(len(constraints)))
    if roomy(conflict):
        return ()
    for row in list(conflict):
        fewer = [other for other in conflict if other != row]
        if not roomy(fewer):
            conflict = fewer
    return tuple(conflict)


# Constraints as a person writes them, such as ``"k7 < k2 < k3"``, read into rows.

_NUMBER = r"(?P<number>(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
_NAME = r"(?P<name>[A-Za-z_]\w*(?:\.\w+)*)"
_RELATION = re.compile(r"([<>]=?)")
# A term with its sign; the sign of an exponent does not begin a new term.
_PIECE = re.compile(r"[+-]?(?:[A-Za-z_][\w.]*|[0-9.]+(?:[eE][+-]?[0-9]+)?|[^+-])+|[+-]")
_TERM = re.compile(rf"(?P<sign>[+-]?)\s*(?=\S)(?:{_NUMBER}\s*(?:\*\s*(?=[A-Za-z_])|$))?{_NAME}?\s*")


def parse_constraints(lines: Sequence[str], names: Sequence[str]) -> LinearConstraints:
    """Read constraints such as ``"k7 < k2 < k3"`` or ``"2*a + 3*b <= 5"`` (Eq. (14), (15)).

    Each line is a chain of sums joined by ``<``, ``<=``, ``>`` or ``>=``; each term is a plain
    number, a parameter, or ``number*parameter``. Numbers are SI. A chain of n sums gives n - 1
    rows, so the ordering of n_p parameters gives the paper's n_p - 1 rows.

    `lines`: the constraints, one text each; `names`: the free parameters, in the order of the columns. Raises
    `InputError` if a text cannot be read or names an unknown parameter; the nearest name is offered.
    """
    rows = [np.zeros((0, len(names) + 1))]
    strict: list[bool] = []
    labels: list[str] = []
    chains: list[list[int]] = []
    for line in lines:
        sides, relations = _split(line)
        sums = np.array([_read_sum(line, side, names) for side in sides])
        if not relations:
            raise _unreadable(line, 'has no "<", "<=", ">" or ">="')
        ascending = ["<" in relation for relation in relations]
        rows.append(np.where(ascending, 1.0, -1.0)[:, None] * np.diff(sums, axis=0) + 0.0)  # without negative zeros
        strict += ["=" not in relation for relation in relations]
        labels += [line.strip()] * len(relations)
        bare = ((sums != 0.0).sum(axis=1) == 1) & (sums[:, :-1] == 1.0).any(axis=1)
        if bare.all() and len(set(ascending)) == 1:
            chains.append(sums.argmax(axis=1)[:: 1 if ascending[0] else -1].tolist())
    matrix = np.vstack(rows)
    return LinearConstraints(matrix[:, :-1], 0.0 - matrix[:, -1], np.array(strict, bool), labels, chains)


def _split(line: str) -> tuple[list[str], list[str]]:
    """Sides of a line and the relations between them."""
    pieces = _RELATION.split(" ".join(line.split()))
    return [side.strip() for side in pieces[::2]], pieces[1::2]


def _read_sum(line: str, side: str, names: Sequence[str]) -> Floats:
    """Coefficients of the parameters and a constant (d + 1,)."""
    total = np.zeros(len(names) + 1)
    for piece in _PIECE.findall(side) or [""]:
        match = _TERM.fullmatch(piece)
        if match is None:
            raise _unreadable(line, f"has {_quoted(piece.lstrip('+-'))} where a term is expected")
        value = float(match["number"] or 1.0)
        if not np.isfinite(value):
            raise _unreadable(line, f"has the number {match['number']}, which is too large")
        column = _column(line, match["name"], names) if match["name"] else len(names)
        total[column] += -value if match["sign"] == "-" else value
    return total


def _quoted(text: str) -> str:
    return f'"{text.strip()}"' if text.strip() else "nothing"


def _column(line: str, name: str, names: Sequence[str]) -> int:
    if name not in names:
        raise InputError(
            f'constraint "{line.strip()}" names "{name}", which is not a free parameter'
            f"{nearest(name, names)}: use one of the parameters to be calibrated",
            code="not-free",
        )
    return list(names).index(name)


_SUMS = (
    'sums of number, parameter or number*parameter joined by <, <=, > or >=, such as "2*a + 3*b <= 5" or "a < b < c"'
)


def _unreadable(line: str, what: str, write: str = _SUMS) -> InputError:
    return InputError(f'constraint "{line.strip()}" {what}: write {write}', code="unreadable-constraint")


# Constraints between products of parameters, such as a preload that holds a valve shut against the pressure.

_FACTOR = re.compile(rf"\s*(?:{_NUMBER}|{_NAME})\s*(?:\^\s*(?P<power>-?[0-9]+(?:\.[0-9]+)?))?\s*")
_PRODUCTS = (
    "one relation between products, such as "
    '"valve.spring_preload >= 1.2 * pi / 4 * valve.seat_diameter^2 * rail_pressure_max"'
)


class ProductConstraint(NamedTuple):
    """Constraint factor · Π x_j^exponent_j >= 1."""

    label: str  # the text that a person wrote
    factor: float  # numbers and values that do not vary
    exponents: Floats  # (d,), one for each free parameter
    strict: bool  # the product must exceed 1 by `STRICT_MARGIN`


class Products:
    """Constraints between products of parameters."""

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
        shortfalls = np.zeros((*x.shape[:-1], len(self)))
        for column, c in enumerate(self.constraints):
            used = np.flatnonzero(c.exponents)
            with np.errstate(all="ignore"):
                ratio = c.factor * np.prod(x[..., used] ** c.exponents[used], axis=-1)
            needed = 1.0 + STRICT_MARGIN if c.strict else 1.0
            short = np.maximum(0.0, 1.0 - ratio / needed)
            shortfalls[..., column] = np.where(np.isnan(short), 1.0, short)
        return shortfalls


NONE = Products()


def parse_products(lines: Sequence[str], names: Sequence[str], fixed_values: Mapping[str, float]) -> Products:
    """Read constraints such as ``"valve.spring_preload >= 1.2 * pi / 4 * valve.seat_diameter^2 * rail_pressure_max"``.

    Each side is a product or quotient of numbers (SI), parameters and powers of them. ``pi`` is defined.

    `lines`: one relation each; `names`: the free parameters, in the order of the columns; `fixed_values`: values [SI]
    of names that do not vary. Raises `InputError` if a text cannot be read, names something unknown or holds no free
    parameter.
    """
    return Products([_read(line.strip(), names, {"pi": math.pi, **fixed_values}) for line in lines])


def _read(line: str, names: Sequence[str], fixed_values: Mapping[str, float]) -> ProductConstraint:
    sides, relations = _split(line)
    if len(relations) != 1:
        raise _unreadable(line, 'needs exactly one of "<", "<=", ">" and ">="', _PRODUCTS)
    small, large = sides if "<" in relations[0] else sides[::-1]
    factors, exponents = zip(*(_product(line, side, names, fixed_values) for side in (large, small)), strict=True)
    total = exponents[0] - exponents[1]
    if not total.any():
        raise _unreadable(line, "depends on no free parameter", _PRODUCTS)
    if not (0.0 < factors[0] < math.inf and 0.0 < factors[1] < math.inf):
        raise _unreadable(line, "has a factor that is not greater than zero, or too large", _PRODUCTS)
    return ProductConstraint(line, factors[0] / factors[1], total, "=" not in relations[0])


def _product(line: str, side: str, names: Sequence[str], fixed_values: Mapping[str, float]) -> tuple[float, Floats]:
    """Factor and exponents of one side."""
    factor, exponents = 1.0, np.zeros(len(names))
    pieces = ["*", *re.split(r"([*/])", side)]
    for sign, text in zip(pieces[::2], pieces[1::2], strict=True):
        match = _FACTOR.fullmatch(text)
        if match is None:
            expected = "a number, a parameter or a power of one"
            raise _unreadable(line, f"has {_quoted(text)} where {expected} is expected", _PRODUCTS)
        power = float(match["power"] or 1.0) * (1.0 if sign == "*" else -1.0)
        if match["number"]:
            factor *= _power(float(match["number"]), power)
        elif match["name"] in names:
            exponents[list(names).index(match["name"])] += power
        elif match["name"] in fixed_values:
            factor *= _power(fixed_values[match["name"]], power)
        else:
            close = nearest(match["name"], [*names, *fixed_values])
            raise InputError(
                f'constraint "{line}" names "{match["name"]}", which is no parameter{close}', code="unknown-name"
            )
    return factor, exponents


def _power(value: float, power: float) -> float:
    """Power of a number; NaN of one that is not greater than zero, infinite if it is too large."""
    with np.errstate(over="ignore", under="ignore"):
        return float(np.float64(value) ** power) if value > 0.0 else math.nan
