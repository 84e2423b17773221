"""The condition on the time step as C, from its Python source.

`engine.stability.bears` is arithmetic on named numbers. Called with symbols in their place it records what it does, one
C statement an operation, so that the formulas have one home.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from commonrail.choices import Actuation
from commonrail.engine.stability import Medium, bears, limiting, room_left
from commonrail.injector.definition import parameter_paths
from commonrail.injector.variants import Variant

__all__ = ["step_condition"]

_CHAMBER = "control_chamber.volume"


def step_condition(variant: Variant) -> str:
    """C function ``cr_bears(p, lift, medium, dt)``: 1 where a step is short enough.

    `p` are the parameters in their order, `lift` the greatest lift of the needle [m], `medium` the fields of `Medium`.
    """
    lines: list[str] = []
    paths = parameter_paths(variant.actuation)
    symbols = {path: _Symbol(f"p[{i}]", lines) for i, path in enumerate(paths)}
    if variant.actuation is not Actuation.DIRECT:
        symbols[_CHAMBER] = room_left(symbols, _Symbol("lift", lines))
    medium = Medium(*(_Symbol(f"medium[{i}]", lines) for i in range(len(Medium._fields))))  # type: ignore[arg-type]
    found = bears(variant, symbols, medium, _Symbol("dt", lines))  # type: ignore[arg-type]
    used = sorted({name for group in limiting(variant.actuation) for name in group})
    return "\n".join(
        [
            f"/* Depends on {', '.join(used)}. */",
            "static int cr_bears(const double *p, double lift, const double *medium, double dt) {",
            "    (void)lift;",
            *(f"    {line}" for line in _used(lines, found.text)),
            f"    return {found.text};",
            "}",
            "",
        ]
    )


def _used(lines: list[str], result: str) -> list[str]:
    """Statements on which the result depends, in their order."""
    wanted, kept = {result}, []
    for line in reversed(lines):
        name, _, expression = line.partition(" = ")
        if name.split()[-1] in wanted:
            wanted.update(re.findall(r"\bt\d+", expression))
            kept.append(line)
    return kept[::-1]


class _Symbol:
    """A number or condition whose value C computes: operations on it append a statement to `lines`."""

    __slots__ = ("lines", "text")

    def __init__(self, text: str, lines: list[str]) -> None:
        self.text, self.lines = text, lines

    def _made(self, expression: str, kind: str = "double") -> _Symbol:
        name = f"t{len(self.lines)}"
        self.lines.append(f"const {kind} {name} = {expression};")
        return _Symbol(name, self.lines)

    def _two(self, left: Any, sign: str, right: Any, kind: str = "double") -> _Symbol:
        return self._made(f"{_text(left)} {sign} {_text(right)}", kind)

    def __add__(self, other: Any) -> _Symbol:
        return self._two(self, "+", other)

    def __radd__(self, other: Any) -> _Symbol:
        return self._two(other, "+", self)

    def __sub__(self, other: Any) -> _Symbol:
        return self._two(self, "-", other)

    def __rsub__(self, other: Any) -> _Symbol:
        return self._two(other, "-", self)

    def __mul__(self, other: Any) -> _Symbol:
        return self._two(self, "*", other)

    def __rmul__(self, other: Any) -> _Symbol:
        return self._two(other, "*", self)

    def __truediv__(self, other: Any) -> _Symbol:
        return self._two(self, "/", other)

    def __rtruediv__(self, other: Any) -> _Symbol:
        return self._two(other, "/", self)

    def __pow__(self, exponent: Any) -> _Symbol:
        if exponent != 0.5:
            raise NotImplementedError(f"a power of {exponent}")
        return self._made(f"sqrt({self.text})")

    def __abs__(self) -> _Symbol:
        return self._made(f"fabs({self.text})")

    def __gt__(self, other: Any) -> _Symbol:
        return self._two(self, ">", other, "int")

    def __ge__(self, other: Any) -> _Symbol:
        return self._two(self, ">=", other, "int")

    def __lt__(self, other: Any) -> _Symbol:
        return self._two(self, "<", other, "int")

    def __le__(self, other: Any) -> _Symbol:
        return self._two(self, "<=", other, "int")

    def __eq__(self, other: object) -> Any:
        return self._two(self, "==", other, "int")

    __hash__ = None  # type: ignore[assignment]

    def __and__(self, other: Any) -> _Symbol:
        return self._two(self, "&", other, "int")

    def __rand__(self, other: Any) -> _Symbol:
        return self._two(other, "&", self, "int")

    def __or__(self, other: Any) -> _Symbol:
        return self._two(self, "|", other, "int")

    def __array_ufunc__(self, function: Any, method: str, *inputs: Any, **_: Any) -> Any:
        known: Mapping[Any, Callable[..., str]] = {
            np.maximum: lambda a, b: f"fmax({a}, {b})",
            np.minimum: lambda a, b: f"fmin({a}, {b})",
        }
        if method != "__call__" or function not in known:
            return NotImplemented
        return self._made(known[function](*map(_text, inputs)))

    def __array_function__(self, function: Any, types: Any, arguments: Any, named: Any) -> Any:
        if function is not np.clip:
            return NotImplemented
        value, low, high = map(_text, arguments)
        return self._made(f"fmin(fmax({value}, {low}), {high})")


def _text(value: Any) -> str:
    """Number as C: symbols by their names, Python's numbers so that they keep all digits."""
    if isinstance(value, _Symbol):
        return value.text
    if isinstance(value, bool):
        return str(int(value))
    number = float(value)
    return f"({number!r})" if number < 0.0 else repr(number)
