"""Meters of a page's data: the responses of their filters, and their quantities, for the page's script."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from commonrail.data.curves.data import RateData
from commonrail.physics.meters import Meter, given_values, low_pass

NEGLIGIBLE = 1e-13  # share of the largest value of a response; what is smaller at its ends is left out


def packed(values: ArrayLike) -> str:
    """Base64 of little-endian doubles."""
    return base64.b64encode(np.asarray(values, "<f8").tobytes()).decode()


def meter_of(d: RateData, dt: float) -> dict[str, Any] | None:
    """Meter of an injection curve, None where there is none or it shows what it is given.

    Parameters
    ----------
    d : RateData
    dt : float
        Time step [s].
    """
    if d.meter is None or d.meter.neutral:
        return None
    given = {key: float(value[0]) for key, value in given_values(d.meter, {}, 1).items()}
    steps = max(round((d.point.duration + d.meter.ahead) / dt), 1)
    echoes = [{key: given[f"{echo}_{key}"] for key in ("share", "delay", "lag")} for echo in ("echo", "second_echo")]
    return {
        "name": d.meter.name,
        "ahead": d.meter.ahead,
        **{key: given[key] for key in ("delay", "gain", "offset", "blend", "zeroing")},
        "echoes": [echo for echo in echoes if echo["share"]],
        "early": _filter(d.meter, given["cutoff"], steps, dt),
        "late": _filter(d.meter, given.get("late_cutoff", np.inf), steps, dt),
    }


def _filter(meter: Meter, cutoff: float, steps: int, dt: float) -> dict[str, Any] | None:
    """Response to a step's unit signal, from its first step that counts; None without a filter."""
    if np.isinf(cutoff):
        return None
    impulse = np.zeros(2 * steps - 1)
    impulse[steps - 1] = 1.0
    response = low_pass(impulse, dt, meter.law, meter.order, cutoff)
    used = np.flatnonzero(np.abs(response) > NEGLIGIBLE * np.max(np.abs(response)))
    return {"first": int(used[0]) - (steps - 1), "response": packed(response[used[0] : used[-1] + 1])}
