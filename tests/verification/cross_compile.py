"""Compile a kernel for the processor that Numba's settings name, without running it, and write its assembly text.

``python -m tests.verification.cross_compile PRECISION FILE [same_bits]``, with ``NUMBA_CPU_NAME`` and
``NUMBA_CPU_FEATURES`` set: Numba reads them when it is imported, so this is a process of its own.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numba
import numpy as np

from commonrail import compile as laws
from commonrail import kernel_cache
from commonrail.choices import Precision
from commonrail.engine import lanes, plan
from commonrail.engine.operating_point import OperatingPoint
from commonrail.files.injector_file import load_injector
from commonrail.fixed_target import TARGET
from commonrail.injector.variants import Variant


def assembly(precision: Precision, same_bits: bool = False) -> str:
    """Return the text of the regulated variant's kernel."""
    injector = replace(load_injector("virtual-lino-2016"), variant=Variant())
    lanes_of_block = lanes.VECTORS[precision].lanes
    prepared = plan.prepare(injector, [OperatingPoint(160e6, 1e-4, horizon=1e-5)], 1e-6)
    job = plan.make_job(prepared, prepared.row[None], True, lanes_of_block)
    samples = lanes.Misfit.none(1).samples(job.dt, job.courses.steps)
    out = np.empty((1, lanes_of_block, len(lanes.Outcome._fields)))
    kernel = lanes.compiled(injector.variant, precision, same_bits).compiled  # type: ignore[attr-defined]
    with laws.compiler_choices(TARGET if same_bits else "cpu"):
        kernel.compile(tuple(map(numba.typeof, (job, samples, np.empty((0, 0, 0, 0)), out, 0, 1))))
    return "\n".join(kernel.inspect_asm().values())


if __name__ == "__main__":
    kernel_cache.cache_folder = lambda: None  # type: ignore[assignment]  # machine code from the cache has no text
    Path(sys.argv[2]).write_text(assembly(Precision(sys.argv[1]), "same_bits" in sys.argv[3:]), encoding="utf-8")
