"""Compile a kernel for the processor that is named, without running it, and write its assembly text.

``python -m tests.verification.cross_compile PRECISION FILE [same_bits]``, with ``NUMBA_CPU_NAME`` and
``NUMBA_CPU_FEATURES`` set: they are for this process alone.
"""

from __future__ import annotations

import sys
from pathlib import Path

from commonrail.base.choices import Precision
from commonrail.compiler import child, lower
from commonrail.compiler.target import System, exact_processor, own_processor
from commonrail.engine import machine_code
from commonrail.engine.job import VECTORS
from commonrail.physics.variants import Variant


def assembly(precision: Precision, same_bits: bool = False) -> str:
    """Return the text of the regulated variant's kernel."""
    processor = exact_processor() if same_bits else own_processor()
    texts = child.texts(machine_code.source_of(Variant(), VECTORS[precision], same_bits))
    machine, code = lower.optimise(texts, {"lanes": "lanes"}, System.of(processor))
    return str(machine.emit_assembly(code))


if __name__ == "__main__":
    Path(sys.argv[2]).write_text(assembly(Precision(sys.argv[1]), "same_bits" in sys.argv[3:]), encoding="utf-8")
