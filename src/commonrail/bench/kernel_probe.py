"""The first simulation of a fresh process: ``python -m commonrail.bench.kernel_probe`` prints JSON.

It tells whether the machine code came from the cache, how long that took, and what the simulation gave.
"""

from __future__ import annotations

import json
import time
from typing import Any

from commonrail.choices import Precision
from commonrail.engine.lanes import compiled
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.simulate import simulate
from commonrail.files.injector_file import load_injector

__all__ = ["first_simulation"]

POINT = OperatingPoint(160e6, 700e-6, horizon=1.56e-3)  # of the paper


def first_simulation() -> dict[str, Any]:
    """Seconds to the first result, where its kernel came from, and the result's figures [SI]."""
    case = load_injector("virtual-lino-2016")
    begin = time.perf_counter()
    found = simulate(case, POINT)
    seconds = time.perf_counter() - begin
    code = compiled(case.wired(), Precision.F64, False)
    return {
        "seconds": seconds,
        "origin": code.origin,
        "processor": code.processor,
        "status": found.status.name,
        "volume": found.injected_volume if found.injected_volume == found.injected_volume else None,
        "balance": found.balance if found.balance == found.balance else None,
    }


if __name__ == "__main__":
    print(json.dumps(first_simulation()))
