"""Time of a call of `Stepper.step`, with the load of the machine: ``python -m benchmarks.stepper_speed``."""

from __future__ import annotations

import os
import time

import numpy as np

import commonrail as cr

CALLS = 2000
LENGTHS = ("1 us", "10 us", "100 us")


def measure(stepper: cr.Stepper, length: str) -> np.ndarray:
    """Times [s] of so many calls of a length, over repeated injections."""
    start, times = stepper.save(), np.empty(CALLS)
    for i in range(CALLS):
        if stepper.time > 2e-3:
            stepper.restore(start)
        begun = time.perf_counter()
        stepper.step(length, command=stepper.time < 700e-6)
        times[i] = time.perf_counter() - begun
    stepper.restore(start)
    return times


def main() -> None:
    """Measure calls of several lengths, each after a warm-up."""
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors, of the minute before")
    stepper = cr.Stepper(cr.load_injector("virtual-lino-2016"), cr.OperatingPoint("160 MPa", []))
    for length in LENGTHS:
        measure(stepper, length)
        times = measure(stepper, length) * 1e6
        texts = [f"{name} {value:.0f}" for name, value in (("median", np.median(times)), ("worst", times.max()))]
        print(f"step({length!r}): {', '.join(texts)}, 99 % within {np.percentile(times, 99):.0f} us")


if __name__ == "__main__":
    main()
