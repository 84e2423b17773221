"""Constraints as a person writes them, such as ``"k7 < k2 < k3"``, read into rows."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from commonrail.arrays import Floats
from commonrail.calibration.constraints import LinearConstraints
from commonrail.errors import InputError, nearest

__all__ = ["parse_constraints"]


_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)"
    r"|(?P<name>[A-Za-z_]\w*(?:\.\w+)*)"
    r"|(?P<relation><=|>=|<|>)"
    r"|(?P<sign>[+-])"
    r"|(?P<times>\*))"
)


class _Token(NamedTuple):
    kind: str
    text: str


class _Side(NamedTuple):
    """One side of a relation: coefficients (d,) and a constant."""

    coefficients: Floats
    constant: float

    @property
    def single(self) -> int | None:
        """Column of the parameter if the side is one bare parameter, else None."""
        columns = np.flatnonzero(self.coefficients)
        bare = len(columns) == 1 and self.constant == 0.0 and self.coefficients[columns[0]] == 1.0
        return int(columns[0]) if bare else None


def parse_constraints(lines: Sequence[str], names: Sequence[str]) -> LinearConstraints:
    """Read constraints such as ``"k7 < k2 < k3"`` or ``"2*a + 3*b <= 5"`` (Eq. (14), (15)).

    Each line is a chain of sums joined by ``<``, ``<=``, ``>`` or ``>=``; each term is a plain
    number, a parameter, or ``number*parameter``. Numbers are SI. A chain of n sums gives n - 1
    rows, so the ordering of n_p parameters gives the paper's n_p - 1 rows.

    Parameters
    ----------
    lines : sequence of str
        The constraints, one text each.
    names : sequence of str
        The free parameters, in the order of the columns.

    Returns
    -------
    LinearConstraints

    Raises
    ------
    InputError
        If a text cannot be read or names an unknown parameter; the nearest name is offered.
    """
    rows: list[Floats] = []
    lower: list[float] = []
    strict: list[bool] = []
    labels: list[str] = []
    chains: list[tuple[int, ...]] = []
    for line in lines:
        sides, relations = _read_line(line, names)
        for (low, high), relation in zip(pairwise(sides), relations, strict=True):
            small, large = (low, high) if relation.startswith("<") else (high, low)
            rows.append(large.coefficients - small.coefficients)
            lower.append(small.constant - large.constant)
            strict.append("=" not in relation)
            labels.append(line.strip())
        chains.extend(_chain(sides, relations))
    matrix = np.array(rows).reshape(len(rows), len(names))
    return LinearConstraints(matrix, np.array(lower), np.array(strict, bool), labels, chains)


def _chain(sides: list[_Side], relations: list[str]) -> Iterator[tuple[int, ...]]:
    """The line as an ascending ordering of bare parameters, if it is one."""
    columns = [side.single for side in sides]
    if None not in columns and len({relation[0] for relation in relations}) == 1:
        ascending = columns if relations[0].startswith("<") else columns[::-1]
        yield tuple(column for column in ascending if column is not None)


def _read_line(line: str, names: Sequence[str]) -> tuple[list[_Side], list[str]]:
    """Sums and the relations between them."""
    sums: list[list[_Token]] = [[]]
    relations: list[str] = []
    for token in _tokens(line):
        if token.kind == "relation":
            relations.append(token.text)
            sums.append([])
        else:
            sums[-1].append(token)
    if not relations:
        raise _unreadable(line, 'has no "<", "<=", ">" or ">="')
    return [_read_sum(line, tokens, names) for tokens in sums], relations


def _tokens(line: str) -> Iterator[_Token]:
    """Split a constraint into tokens."""
    text = line.rstrip()
    position = 0
    while position < len(text):
        match = _TOKEN.match(text, position)
        if match is None:
            rest = text[position:].lstrip()
            raise _unreadable(line, f'cannot be read from "{rest[:12]}" on')
        position = match.end()
        yield _Token(str(match.lastgroup), str(match[str(match.lastgroup)]))


def _read_sum(line: str, tokens: list[_Token], names: Sequence[str]) -> _Side:
    """Add up the terms of one side."""
    coefficients = np.zeros(len(names))
    constant = 0.0
    for sign, factors in _terms(line, tokens):
        column, value = _read_term(line, factors, names)
        if column is None:
            constant += sign * value
        else:
            coefficients[column] += sign * value
    return _Side(coefficients, constant)


def _terms(line: str, tokens: list[_Token]) -> Iterator[tuple[float, list[_Token]]]:
    """Signed terms of a sum, each as its factors and the ``*`` between them."""
    sign, factors = 1.0, list[_Token]()
    for index, token in enumerate(tokens):
        if token.kind != "sign":
            factors.append(token)
            continue
        if index > 0:
            yield sign, factors
        sign, factors = (-1.0 if token.text == "-" else 1.0), []
    yield sign, factors


def _read_term(line: str, factors: list[_Token], names: Sequence[str]) -> tuple[int | None, float]:
    """Column (None for a constant) and value of one term."""
    kinds = [factor.kind for factor in factors]
    if kinds == ["number"]:
        return None, _number(line, factors[0].text)
    if kinds == ["name"]:
        return _column(line, factors[0].text, names), 1.0
    if kinds == ["number", "times", "name"]:
        return _column(line, factors[2].text, names), _number(line, factors[0].text)
    written = " ".join(factor.text for factor in factors)
    found = f'"{written}"' if written else "nothing"
    raise _unreadable(line, f"has {found} where a term is expected")


def _number(line: str, text: str) -> float:
    value = float(text)
    if not np.isfinite(value):
        raise _unreadable(line, f"has the number {text}, which is too large")
    return value


def _column(line: str, name: str, names: Sequence[str]) -> int:
    if name not in names:
        raise InputError(
            f'constraint "{line.strip()}" names "{name}", which is not a free parameter'
            f"{nearest(name, names)}: use one of the parameters to be calibrated"
        )
    return list(names).index(name)


def _unreadable(line: str, what: str) -> InputError:
    return InputError(
        f'constraint "{line.strip()}" {what}: write sums of number, parameter or number*parameter '
        'joined by <, <=, > or >=, such as "2*a + 3*b <= 5" or "a < b < c"'
    )
