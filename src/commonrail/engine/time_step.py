"""Time steps of the fast engines: their limits, round ones, advice."""

from __future__ import annotations

import math

from commonrail.arguments import Limits, Quantity, amount

TIME_STEPS = Limits(1e-9, 1e-4, (50e-9, 10e-6), ("us", "ns"))
DEFAULT_STEP = 1e-6  # [s]; its error is measured by `commonrail verify`
ROUND_STEPS = (1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 7.5)  # times a power of ten


def check_step(time_step: Quantity) -> float:
    """Read a time step [s], from 1 ns to 100 us."""
    return amount(time_step, "s", "time step", TIME_STEPS)


def step_advice(longest: float) -> str:
    """Sentence that names a time step within the longest one [s]."""
    step = nice_step(longest)
    return f"A step of {step * 1e6:g} us would do." if step >= TIME_STEPS.low else "No step is short enough."


def nice_step(longest: float) -> float:
    """Largest round time step [s] that leaves five per cent to the longest, 0 if there is none."""
    if not longest > 0.0:
        return 0.0
    decade = 10.0 ** math.floor(math.log10(0.95 * longest))
    return max(round(part * decade, 15) for part in ROUND_STEPS if part * decade <= 0.95 * longest)
