"""One population in a process of its own: ``python -m benchmarks.probe CANDIDATES RUNS SECONDS`` prints JSON.

Only a fresh process can tell the greatest memory of one population.
"""

from __future__ import annotations

import json
import re
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

from benchmarks.case import POINT, candidates, injector
from benchmarks.timing import Effort, time_best
from commonrail.engine.simulate import simulate_batch
from commonrail.engine.threads import usable_threads
from commonrail.plugins.paper import study

__all__ = ["probe"]


def probe(count: int, effort: Effort) -> dict[str, Any]:
    """Time and memory of a population on all threads; the kernel is loaded before."""
    simulate_batch(injector(), [POINT], study.NAMES, candidates(1), stop_when_closed=False)
    before = peak_memory()
    values = candidates(count)

    def run() -> None:
        simulate_batch(injector(), [POINT], study.NAMES, values, stop_when_closed=False)

    timing = time_best(run, effort)
    return {
        "candidates": count,
        "threads": usable_threads(),
        "seconds": timing.seconds,
        "runs": timing.runs,
        "peak_bytes": peak_memory(),
        "before_bytes": before,
        "per_second": count / timing.seconds,
    }


def peak_memory() -> int | None:
    """Greatest memory of this process until now [bytes]; None where the system does not tell.

    On Linux not by ``ru_maxrss``: a process that was started by another begins with the greatest memory of that one.
    """
    with suppress(OSError):
        match = re.search(r"^VmHWM:\s*(\d+) kB", Path("/proc/self/status").read_text(encoding="utf-8"), re.M)
        if match:
            return 1024 * int(match[1])
    try:
        import resource
    except ImportError:
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024


if __name__ == "__main__":
    print(json.dumps(probe(int(sys.argv[1]), Effort(int(sys.argv[2]), float(sys.argv[3])))))
