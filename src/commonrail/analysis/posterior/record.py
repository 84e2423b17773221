"""Posterior as the JSON-able record that result.json keeps under "certainty", "posterior"."""

from __future__ import annotations

from typing import Any

import numpy as np

from commonrail.analysis.posterior.sample import Posterior
from commonrail.display.text import number

__all__ = ["posterior_record"]


def posterior_record(found: Posterior, level: float = 0.95) -> dict[str, Any]:
    """Record of a posterior; no interval and no median if the chains do not agree.

    Parameters
    ----------
    found : Posterior
    level : float
        Share of the draws within an interval.
    """
    size = len(found.names)
    low, high, middle = np.full((3, size), np.nan)
    if found.converged:
        low, high = found.interval(level)
        middle = np.median(found.points(), axis=0)
    chains, steps, _ = found.unit.shape
    return {
        "level": level,
        "refused": found.refusal,
        "chains": chains,
        "steps": steps,
        "accepted": found.accepted,
        "simulated": found.simulated,
        "failed": found.failed,
        "seed": found.seed,
        "parameters": [
            {
                "name": name,
                "median": number(float(middle[i])),
                "lower": number(float(low[i])),
                "upper": number(float(high[i])),
                "r_hat": number(float(found.r_hat[i])),
                "effective": number(float(found.effective[i])),
            }
            for i, name in enumerate(found.names)
        ],
    }
