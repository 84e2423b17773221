"""Elementary functions, sums of products and small linear systems whose bits do not depend on the processor.

NumPy and the C library choose among several versions of exp, log, pow and sin by processor, and BLAS among several
matrix products. The functions of this module consist of additions, multiplications, divisions and roots of arrays in a
fixed order, each rounded once, and give equal bits everywhere. Their errors are a few roundings. Laws call `sine`,
`cosine` and `exponential`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from commonrail.base.arrays import Floats
from commonrail.physics.law import physics

# ln 2 in two parts; the first has so few digits that its product with the exponent of a number is exact
_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
_PER_LN2 = 1.44269504088896338700
_EXP = tuple(1.0 / math.factorial(k) for k in range(15))  # Taylor: exact to rounding for |x| up to ln 2/2
_EXPM1 = tuple(1.0 / math.factorial(k + 1) for k in range(19))  # exact to rounding for |x| up to 1
_LOG = tuple(1.0 / (2 * k + 1) for k in range(13))  # area tangent, for mantissas from √½ to √2
_SINE = tuple((-1.0) ** k / math.factorial(2 * k + 1) for k in range(12))  # Taylor: exact to rounding for |x| up to π/2
_RANGE = 800.0  # beyond, an exponential is zero or infinite
_SMALLEST = -708.0  # below it the exponential is not a normal number


def _series(coefficients: tuple[float, ...], x: Floats) -> Floats:
    """Polynomial of ascending coefficients, by Horner's scheme."""
    total = np.full(x.shape, coefficients[-1])
    for coefficient in coefficients[-2::-1]:
        total = coefficient + x * total
    return total


def exp(x: ArrayLike) -> Floats:
    """Return the exponential of an array."""
    bounded = np.clip(np.asarray(x, dtype=np.float64), -_RANGE, _RANGE)
    power_of_two = np.rint(bounded * _PER_LN2)
    rest = (bounded - power_of_two * _LN2_HIGH) - power_of_two * _LN2_LOW
    with np.errstate(invalid="ignore", over="ignore", under="ignore"):
        return np.ldexp(_series(_EXP, rest), np.nan_to_num(power_of_two).astype(np.int32))


def expm1(x: ArrayLike) -> Floats:
    """Return exp(x) − 1 of an array, exact near zero too."""
    at = np.asarray(x, dtype=np.float64)
    small = np.clip(at, -1.0, 1.0)
    return np.where(np.abs(at) < 0.7, small * _series(_EXPM1, small), exp(at) - 1.0)


def log(x: ArrayLike) -> Floats:
    """Return the natural logarithm of an array; −∞ at zero, NaN below it."""
    at = np.asarray(x, dtype=np.float64)
    mantissa, exponent = np.frexp(at)
    low = mantissa < math.sqrt(0.5)
    mantissa, exponent = np.where(low, 2.0 * mantissa, mantissa), exponent - low
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = (mantissa - 1.0) / (mantissa + 1.0)
        logarithm = exponent * _LN2_HIGH + (2.0 * ratio * _series(_LOG, ratio * ratio) + exponent * _LN2_LOW)
        logarithm = np.where(at > 0.0, logarithm, np.where(at == 0.0, -np.inf, np.nan))
    return np.where(at == np.inf, np.inf, logarithm)


def power(base: ArrayLike, exponent: ArrayLike) -> Floats:
    """Return base**exponent for base ≥ 0; the error in roundings grows with exponent × log(base)."""
    b, e = np.asarray(base, dtype=np.float64), np.asarray(exponent, dtype=np.float64)
    with np.errstate(invalid="ignore"):
        raised = exp(e * log(b))
    return np.where(e == 0.0, 1.0, raised)


@physics
def quarter_sine(x: Any) -> Any:
    """Return sin x of angles from −π/2 to π/2 [rad], a number or an array."""
    square = x * x
    total = _SINE[11]
    for k in range(10, -1, -1):
        total = _SINE[k] + square * total
    return x * total


@physics
def sine(x: float) -> float:
    """Return sin x of an angle from −π/2 to 3π/2 [rad]; beyond, accuracy is lost."""
    return quarter_sine(x if x <= 0.5 * math.pi else math.pi - x)  # type: ignore[no-any-return]


@physics
def cosine(x: Any) -> Any:
    """Return cos x of angles from −π to π [rad], a number or an array."""
    return quarter_sine(0.5 * math.pi - abs(x))


@physics
def exponential(x: float) -> float:
    """Return exp x of a decay, 0 where it is not a normal number; for kernels, which have no `ldexp`.

    `x`: exponent [1], ≤ 0. It is split into multiples of ln 2, which become halvings, and a rest for the series.
    """
    if x < _SMALLEST:
        return 0.0
    halvings = int(0.5 - x / _LN2_HIGH)
    rest = (x + halvings * _LN2_HIGH) + halvings * _LN2_LOW
    total = _EXP[13]
    for k in range(12, -1, -1):
        total = _EXP[k] + rest * total
    factor = 0.5
    while halvings > 0:
        if halvings & 1:
            total *= factor
        factor *= factor
        halvings >>= 1
    return total


def product(left: Floats, right: Floats) -> Floats:
    """Product (…, n) of an array (…, d) and a matrix (d, n), summed from the first of d to the last.

    `left`: (…, d); `right`: (d, n).
    """
    total = np.zeros((*left.shape[:-1], right.shape[1]))
    for k, row in enumerate(right):
        total += left[..., k, None] * row
    return total


# Small dense linear systems, in a stated order of operations: their bits do not depend on the processor.
#
# Polynomials of a fuel and starting populations are made with them; fits by least squares use LAPACK. For at most some
# tens of unknowns. LAPACK chooses its inner loops by processor. Here every operation is a NumPy operation on whole rows
# or columns, or a sum along one, with equal rounding everywhere.


def least_squares(matrix: Floats, target: Floats) -> Floats:
    """Return x (…, n) of least ‖matrix x − target‖, by Householder reflections with column pivoting.

    Columns that depend linearly on the others, to machine precision times the larger of m and n, get x = 0.

    `matrix` is (…, m, n) with m ≥ 1, `target` (…, m). Each system has the bits of a separate solution.
    """
    rows, columns = np.shape(matrix)[-2:]
    many = math.prod(np.shape(matrix)[:-2])
    a = np.array(matrix, dtype=float).reshape(many, rows, columns)
    b = np.array(target, dtype=float).reshape(many, rows)
    systems = np.arange(len(a))
    order = np.tile(np.arange(columns), (len(a), 1))
    limit = (np.finfo(float).eps * max(rows, columns)) ** 2
    largest, rank = np.zeros(len(a)), np.zeros(len(a), int)
    going = np.ones(len(a), bool)
    for k in range(min(rows, columns)):
        squares = np.sum(a[:, k:, k:] * a[:, k:, k:], axis=1)
        best = np.argmax(squares, axis=1)
        size = squares[systems, best]
        largest = np.where(going, np.maximum(largest, size), largest)
        going &= size > limit * largest
        if not going.any():
            break
        active = systems[going]
        best = k + best[going]
        a[active, :, k], a[active, :, best] = a[active, :, best], a[active, :, k]
        order[active, k], order[active, best] = order[active, best], order[active, k]
        a[active, k:, k:], b[active, k:] = _reflect(a[active, k:, k:], b[active, k:])
        rank[active] = k + 1
    x = np.zeros((len(a), columns))
    for i, r in enumerate(rank.tolist()):
        x[i, order[i, :r]] = solve_upper(a[i, :r, :r], b[i, :r])
    return x.reshape(*np.shape(matrix)[:-2], columns)


def _reflect(a: Floats, b: Floats) -> tuple[Floats, Floats]:
    """Systems (k, m, n) and (k, m), reflected so that the first column vanishes below its first row."""
    column = a[:, :, 0].copy()
    length = np.sqrt(np.sum(column * column, axis=1))
    column[:, 0] += np.copysign(length, column[:, 0])
    scale = 2.0 / np.sum(column * column, axis=1)
    shares = scale[:, None] * np.sum(column[:, :, None] * a, axis=1)
    along = scale * np.sum(column * b, axis=1)
    return a - column[:, :, None] * shares[:, None, :], b - column * along[:, None]


def cholesky(matrix: Floats) -> Floats:
    """Lower root (n, n) of a symmetric positive definite matrix; NaN where it is not."""
    rest = np.array(matrix, dtype=float)
    root = np.zeros_like(rest)
    for k in range(len(rest)):
        column = rest[k:, k] / np.sqrt(rest[k, k])
        root[k:, k] = column
        rest[k:, k:] -= column[:, None] * column
    return root


def solve_lower(lower: Floats, right_side: Floats) -> Floats:
    """Solve lower x = wanted, of one right side (n,) or several (n, k)."""
    x = np.array(right_side, dtype=float)
    for k in range(len(lower)):
        x[k] = x[k] / lower[k, k]
        x[k + 1 :] -= lower[k + 1 :, k].reshape(-1, *[1] * (x.ndim - 1)) * x[k]
    return x


def solve_upper(upper: Floats, right_side: Floats) -> Floats:
    """Solve upper x = wanted, of one right side (n,) or several (n, k)."""
    return solve_lower(upper[::-1, ::-1], right_side[::-1])[::-1]
