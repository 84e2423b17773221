"""A model that is linear in its parameters, with a likelihood whose intervals are known in closed form."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from commonrail.calibration.parameter import Parameter
from commonrail.calibration.space import Space
from commonrail.data.noise import NOISE, Noise
from commonrail.plugins.certainty.estimate import Estimate, estimate
from commonrail.plugins.certainty.likelihood import Likelihood
from commonrail.plugins.certainty.noise_fit import Block

Floats = NDArray[np.float64]

N = 300
TRUTH = np.array([2.0, 3.0, 5.0])


def design(n: int = N) -> Floats:
    """Derivatives (n, 3): a ramp, a slow wave, a bump."""
    t = np.linspace(0.0, 1.0, n)
    return np.column_stack([t, np.cos(5.0 * t), np.exp(-(((t - 0.5) / 0.1) ** 2))])


def space(dimension: int = 3, constraints: Sequence[str] = (), scale: str = "linear") -> Space:
    """Bounds of 0.1 to 10 for parameters a, b, c."""
    parameters = [
        Parameter(name, 4.0, 0.1, 10.0, "1", mark="E", source="test", scale=scale)  # type: ignore[arg-type]
        for name in "abc"[:dimension]
    ]
    return Space(parameters, constraints)


def likelihood(
    measured: Sequence[Floats],
    designs: Sequence[Floats],
    noises: Sequence[Noise] = (),
    room: Space | None = None,
) -> Likelihood:
    """Likelihood of blocks of measured values under linear models; values beyond 1e6 count as failed."""
    blocks, start = [], 0
    for i, y in enumerate(measured):
        rows = slice(start, start := start + len(y))
        noise = noises[i] if noises else NOISE
        ordered = len(y) > 20
        blocks.append(Block(f"set {i + 1}", rows, noise, "1", ordered, -y, np.ones(len(y)), _places(len(y))))
    together, target = np.concatenate(designs), np.concatenate(measured)

    def residuals(points: Floats) -> Floats:
        return np.asarray(points @ together.T - target)

    return Likelihood(room or space(together.shape[1]), blocks, residuals)


def interval(found: Estimate) -> tuple[Floats, Floats]:
    """Ends of the intervals by the curvature."""
    half = found.half_widths() * np.abs(found.likelihood.scaled(found.unit))
    return found.point - half, found.point + half


def fitted(own: Likelihood, starts: int = 1) -> Estimate:
    """Estimate from starts that lie in a row."""
    d = own.space.dimension
    return estimate(own, np.linspace(0.4, 0.6, starts)[:, None] * np.ones(d))


def _places(n: int) -> Floats:
    return np.column_stack([np.linspace(0.0, 1.0, n), np.zeros(n)])
