"""Compile what tests wait for, modules and kernels: ``PYTHONPATH=src python -m tools.compile_ahead f64``, or f32.

`make test` does it on a fresh machine while pip, which waits for network and disk, installs what only the tests need. A
kernel in the cache is left as it is; a test whose kernel is being compiled here waits for it.
"""

from __future__ import annotations

import importlib
import pkgutil
import sys
from contextlib import suppress

import commonrail
from commonrail.base.choices import Actuation, Body, Boundary, Drive, Laws, Precision
from commonrail.compiler.target import own_processor
from commonrail.engine.job import VECTORS
from commonrail.engine.machine_code import object_of
from commonrail.physics.variants import Variant

# Those that the tests begin with, in their order: see `DOUBLE` and `OTHERS` in tests/conftest.py. What is compiled
# after the first of a precision shares its laws: one process for each.
WIRINGS = {
    Precision.F64: (
        Variant(),
        Variant(drive=Drive.PWM),
        Variant(Body.RIGID, drive=Drive.PWM),
        Variant(boundary=Boundary.VOLUME),
        Variant(drive=Drive.VOLTAGE),
        Variant(laws=Laws.EXTENDED),
        Variant(drive=Drive.PWM, laws=Laws.EXTENDED),
        Variant(drive=Drive.CURRENT, actuation=Actuation.DIRECT),
        Variant(Body.RIGID),
    ),
    Precision.F32: (Variant(drive=Drive.PWM), Variant()),
}


def main() -> None:
    """Compile all modules to bytecode, which each process of the tests would do, and kernels for this processor."""
    precision = Precision(sys.argv[1])
    for module in pkgutil.walk_packages(commonrail.__path__, "commonrail."):
        if not module.name.endswith("__main__"):
            with suppress(Exception):  # an extra that is not there yet, or not whole
                importlib.import_module(module.name)
    for wiring in WIRINGS[precision]:
        object_of(wiring, VECTORS[precision], own_processor())


if __name__ == "__main__":
    main()
