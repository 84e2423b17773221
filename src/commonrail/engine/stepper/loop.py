"""The loop that the lanes run, for one lane whose memory is its caller's: put at rest, and taken on by given inputs."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from commonrail.engine.block import FUEL, any_vectors, make_advance, make_begin
from commonrail.engine.feed import Memory, copy_number, make_wave_transport
from commonrail.engine.recorder import make_rows
from commonrail.physics.law import FLUSH_TINY, KEEP_ALL, KEEP_NONE
from commonrail.physics.model import Inputs, Setting
from commonrail.physics.variants import Variant, wiring


class Loop(NamedTuple):
    """Compiled functions of a variant, and where its memory holds its state."""

    # function (memory, ring, first, theta, settings, inputs): without `inputs` it puts the memory to rest; else it
    # takes one step for each row of them, the first of them with the number `first`
    march: Callable[..., Any]
    rows: Any
    # names of the rows of the state, which begin at `rows.state`; behind them are the three waves that leave
    state: tuple[str, ...]
    parameters: int  # length of `theta`

    def size(self, ring: int) -> int:
        """Numbers in the memory of an injector whose rings have so many slots."""
        return int(self.rows.end) + max(3 * ring, self.parameters)


@functools.cache
def make_loop(variant: Variant) -> Loop:
    """`Loop` of a variant, compiled (or loaded from the cache) at its first call."""
    wired, rows = wiring(variant), make_rows(variant, 1)
    from commonrail.compiler.numba import kernel

    march = kernel(make_march(variant, rows), f"stepper: {variant.label}")
    return Loop(march, rows, wired.state.paths, len(wired.parameters.paths) + len(FUEL.paths))


def make_march(variant: Variant, rows: Any) -> Callable[..., None]:
    """The loop over steps, to be compiled; `rows`: of one lane."""
    from commonrail.compiler.numba import exchange_rounding

    begin, advance = make_begin(variant, rows), make_advance(variant, rows, any_vectors)
    arrive, leave = make_wave_transport(rows, copy_number)
    size, order = rows.end, (0, 0)  # point and candidate of the one lane

    def march(memory, ring, first, theta, settings, inputs):  # type: ignore[no-untyped-def]
        mode = exchange_rounding(FLUSH_TINY, KEEP_ALL)
        held, dt = Memory(memory[:size], memory[size:], ring), settings[3]
        if inputs.shape[0] == 0:
            at_rest = Setting(settings[0], settings[1], settings[2], dt)
            begin(held, theta, order, at_rest, np.empty((1, 12)))
        for i in range(inputs.shape[0]):
            u = inputs[i]
            arrive(held, first + i, True)
            advance(held.work, float(first + i + 1), Inputs(u[0], u[1], u[2], u[3], u[4], u[5]), dt)
            leave(held, first + i)
        exchange_rounding(mode, KEEP_NONE)

    return march
