"""Entry points that march a block of injectors side by side, one in each lane of vector registers.

========================  ==============================================================================================
entry                     arguments
========================  ==============================================================================================
``kernel_block``          work (rows, LANES), waves (3 ring, LANES), ring, first, count, inputs (count, inputs, LANES),
                          dt, alike: steps first … first + count − 1; alike is 1 where all waves take as long
``kernel_block_figures``  work, figures (LANES, figures): reads the fields of `engine.notes.Outcome` of all lanes
========================  ==============================================================================================

A block is put together from single injectors (`export.entries`): a lane has the rows that an injector has alone.
"""

from __future__ import annotations

from typing import Any

from numba import types

from commonrail.engine.block import INPUTS, Law, make_advance, make_own_inputs
from commonrail.engine.feed import Memory, make_wave_transport
from commonrail.engine.notes import Outcome, report_remaining
from commonrail.engine.registers import row_copier, row_gatherer
from commonrail.engine.rows import make_rows
from commonrail.export.entries import view
from commonrail.injector.variants import Variant
from commonrail.jit import widest_vectors

__all__ = ["LANES", "make_block_entries"]

LANES = 8  # numbers in the widest registers there are, and cylinders of most engines


def make_block_entries(variant: Variant) -> dict[str, tuple[Law, Any]]:
    """Functions and Numba signatures of a wiring's block by the name of the entry."""
    rows, copy = make_rows(variant, LANES), row_copier(LANES)
    advance = make_advance(variant, rows, widest_vectors, make_own_inputs())
    arrive, leave = make_wave_transport(rows, copy, row_gatherer(LANES))
    working, first_input, given, noted = rows.end, rows.inputs, len(INPUTS.paths), len(Outcome._fields)

    def march(work, waves, ring, first, count, inputs, dt, alike):  # type: ignore[no-untyped-def]
        widest_vectors()
        memory = Memory(view(work, 0, (working * LANES,)), view(waves, 0, (3 * ring * LANES,)), ring)
        table = view(inputs, 0, (count * given * LANES,))
        for n in range(count):
            k = first + n
            for i in range(given):
                copy(memory.work, (first_input + i) * LANES, table, (n * given + i) * LANES)
            arrive(memory, k, alike != 0)
            advance(memory.work, float(k + 1), k, dt)
            leave(memory, k)

    def figures(work, out):  # type: ignore[no-untyped-def]
        numbers = view(work, 0, (working * LANES,))
        # every step sets the cylinder pressure of all lanes anew, and what depends on it here is not read
        report_remaining(numbers, rows, numbers[rows.cylinder * LANES], view(out, 0, (LANES, noted)))

    place, real, whole = types.CPointer(types.float64), types.float64, types.int64
    return {
        "kernel_block": (march, types.void(place, place, whole, whole, whole, place, real, whole)),
        "kernel_block_figures": (figures, types.void(place, place)),
    }
