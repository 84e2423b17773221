"""Small functions to be compiled, in place of a simulation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from commonrail.compiler import cache
from commonrail.compiler.cache import Source
from commonrail.compiler.load import Kernel
from commonrail.compiler.table import REAL, Array, floats
from commonrail.physics.law import physics

GIVEN = (REAL, floats(1))  # x, array for the result


def fresh_cache() -> None:
    """Forget which folder is used, as another process would not know it."""
    for known in (cache.cache_folder, cache.private_folder):
        known.cache_clear()


@physics
def double(x: Any) -> Any:
    return 2.0 * x


@physics
def poly(x: Any) -> Any:
    return 2.0 * x * x + 3.0 * x - 7.0


@physics
def allocating(x: Any) -> Any:
    return np.full(int(x), x).sum()


FACTOR = 0.3


@physics
def scaled(x: Any) -> Any:
    return 0.1 + FACTOR * x


def entries(*names: str) -> dict[str, tuple[Callable[..., Any], Any]]:
    from commonrail.compiler.laws import TABLE, of_table

    def made(law: Any) -> Any:
        def function(x, out):  # type: ignore[no-untyped-def]
            out[0] = law(x)
            return 0

        return of_table(function, GIVEN)

    def single(x, out):  # type: ignore[no-untyped-def]
        out[0] = scaled(x[0])
        return 0

    numbers = Array(REAL, 1)
    return {
        name: (of_table(single, (numbers, numbers), np.float32) if name == "single" else made(globals()[name]), TABLE)
        for name in names
    }


def source(name: str = "double", kind: str = "f64") -> Source:
    return Source(f"{__name__}:entries", (name,), kind)


def value(x: float, name: str = "double") -> float:
    """Value of a function of this module, compiled."""
    out = np.zeros(1)
    Kernel(source(name), name, GIVEN)(x, out)
    return float(out[0])
