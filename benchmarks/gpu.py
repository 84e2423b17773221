"""Throughput of the engine for NVIDIA GPUs compared with the lanes on the same machine: ``python -m benchmarks.gpu``.

Populations of `benchmarks.case` at one operating point, every candidate over the whole horizon. Times are the shortest
of several runs after one that is not counted and hold the copies to and from the device. Deviations are those of
injected masses from the lanes' in the same precision, relative to the greatest.
"""

from __future__ import annotations

import functools
import json
import sys
import time
from typing import Any

import numpy as np

from benchmarks.case import CASE, POINT, TIME_STEP, candidates, injector
from benchmarks.timing import Effort, time_best
from commonrail.base.choices import Engine, Precision
from commonrail.engine import cuda, plan
from commonrail.engine.simulate import simulate_batch
from commonrail.engine.solution import Batch
from commonrail.engine.threads import usable_threads
from commonrail.plugins.doctor.run import machine
from commonrail.plugins.paper import study

COUNTS = (512, 8_192, 65_536, 131_072)
EFFORT = Effort(5, 2.0)


def rows() -> list[dict[str, Any]]:
    """One a precision and population: seconds and candidates a second of both engines, first call, deviation."""
    table = []
    for precision in Precision:
        began, first = time.perf_counter(), None
        for count in COUNTS:
            values, prepared = candidates(count), plan.prepare(injector(), [POINT], TIME_STEP)

            def run(engine: Engine, values: Any = values, prepared: Any = prepared, p: Any = precision) -> Batch:
                return simulate_batch(
                    injector(),
                    [POINT],
                    study.NAMES,
                    values,
                    time_step=TIME_STEP,
                    stop_when_closed=False,
                    precision=p,
                    prepared=prepared,
                    engine=engine,
                )

            on_device = run(Engine.CUDA).injected_mass
            first = first or time.perf_counter() - began
            on_lanes = run(Engine.LANES).injected_mass
            row: dict[str, Any] = {"precision": precision.value, "candidates": count, "first_call": first}
            for engine in (Engine.CUDA, Engine.LANES):
                seconds = time_best(functools.partial(run, engine), EFFORT).seconds
                row |= {f"{engine.value}_seconds": seconds, f"{engine.value}_per_second": count / seconds}
            row["deviation"] = float(np.abs(on_device - on_lanes).max() / np.abs(on_lanes).max())
            table.append(row)
            print(json.dumps(row), flush=True)
    return table


def main() -> int:
    """Print one JSON object a line, the machine first."""
    reason = cuda.missing()
    if reason is not None:
        print(reason, file=sys.stderr)
        return 2
    from numba import cuda as numba_cuda

    device = numba_cuda.get_current_device().name
    name = device.decode() if isinstance(device, bytes) else device
    print(json.dumps({"case": CASE, "device": name, "threads": usable_threads(), "machine": machine()}), flush=True)
    rows()
    return 0


if __name__ == "__main__":
    sys.exit(main())
