"""Traces for tests of the engines."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from commonrail.plugins.verification.closed_forms import trace_states

Floats = NDArray[np.float64]


def sampled(mass: Floats, dt: float, interval: float = 4e-6) -> Floats:
    """Mean flow between bounds `interval` apart, from the mass after every step."""
    return np.asarray(np.diff(mass[:: round(interval / dt)]) / interval)


__all__ = ["sampled", "trace_states"]
