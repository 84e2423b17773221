"""Predictions of measurements that are not made yet, and their derivatives at draws of the parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.analysis.certainty.block import FittedNoise
from commonrail.analysis.design.candidates import Candidate, planned
from commonrail.calibration.space import Space
from commonrail.kinds import DataSet, QuantityData, RateData
from commonrail.kinds.simulator import Simulator

__all__ = ["STEP", "Response", "responses_of", "slopes_of"]

Floats = NDArray[np.float64]

STEP = 5e-3  # of a central difference, in positions between the bounds, as in `likelihood`


class Response(NamedTuple):
    """Measurement that could be made, as a linear model at each draw.

    Attributes
    ----------
    candidate : Candidate
    value : float
        Quantity at the most likely values [m³]; NaN where that is not the kind's value or the simulation failed.
    scale : float
        Unit of the rows, for a quantity: tolerance [m³]; NaN for a curve.
    rows : (s, r, d)
        Derivatives of the whitened values with respect to the positions; zero at draws that fail.
    plain : (s, d)
        Derivatives of a quantity in tolerances; zero for a curve.
    failed : int
        Draws at which a simulation failed.
    """

    candidate: Candidate
    value: float
    scale: float
    rows: Floats
    plain: Floats
    failed: int


def slopes_of(values: Callable[[Floats], Floats], space: Space, unit: Floats) -> Floats:
    """Derivatives (s, d, n) of values with respect to positions, NaN where a simulation failed.

    Parameters
    ----------
    values : function of (m, d) [SI]
        Values (m, n).
    space : Space
    unit : (s, d)
        Positions.
    """
    s, d = unit.shape
    moves = STEP * np.eye(d)
    ahead, behind = (np.clip(unit[:, None] + sign * moves, 0.0, 1.0) for sign in (1.0, -1.0))
    both = np.concatenate([ahead.reshape(-1, d), behind.reshape(-1, d)])
    found = values(space.from_unit(both)).reshape(2, s, d, -1)
    width = np.einsum("sdd->sd", ahead - behind)
    return np.asarray((found[0] - found[1]) / width[..., None])


def responses_of(
    candidates: Sequence[Candidate],
    data: Sequence[DataSet],
    noises: dict[str, FittedNoise],
    simulator: Simulator,
    space: Space,
    unit: Floats,
) -> list[Response]:
    """Responses of candidates, in order.

    Parameters
    ----------
    candidates : sequence of Candidate
    data : sequence of DataSet
        That there are.
    noises : mapping of str to FittedNoise
        Noise of a measurement of each kind.
    simulator : Simulator
        Of the parameters of the space.
    space : Space
    unit : (s, d)
        Draws, the most likely positions first.
    """
    found: dict[int, Response] = {}
    for kind in dict.fromkeys(one.kind for one in candidates):
        which = [i for i, one in enumerate(candidates) if one.kind == kind]
        own = [candidates[i] for i in which]
        sets, noise = planned(kind, [one.point for one in own], data), noises[kind]
        if isinstance(sets[0], QuantityData):
            made = _of_map(own, sets[0], noise, simulator, space, unit)
        else:
            made = [_of_curve(c, one, noise, simulator, space, unit) for c, one in zip(own, sets, strict=True)]
        found |= dict(zip(which, made, strict=True))
    return [found[i] for i in range(len(candidates))]


def _of_map(
    own: Sequence[Candidate],
    data: QuantityData,
    noise: FittedNoise,
    simulator: Simulator,
    space: Space,
    unit: Floats,
) -> list[Response]:
    best = data.simulated(simulator, space.from_unit(unit[:1]))[0]
    data = replace(data, quantity=np.maximum(np.where(np.isfinite(best), best, 0.0), 0.0))
    tolerance = data.absolute + data.relative * data.quantity
    slopes = slopes_of(lambda points: data.residuals(data.simulated(simulator, points)), space, unit)
    sound = np.asarray(np.isfinite(slopes).all(axis=1) & np.isfinite(best))  # (s, n)
    plain = np.where(sound[:, None], slopes, 0.0)
    return [
        Response(
            one,
            float(best[i]),
            float(tolerance[i]),
            plain[:, None, :, i] / noise.scale,
            plain[..., i],
            int(np.count_nonzero(~sound[:, i])),
        )
        for i, one in enumerate(own)
    ]


def _of_curve(
    own: Candidate, data: DataSet, noise: FittedNoise, simulator: Simulator, space: Space, unit: Floats
) -> Response:
    slopes = slopes_of(lambda points: data.residuals(data.simulated(simulator, points)), space, unit)
    sound: NDArray[np.bool_] = np.asarray(np.isfinite(slopes).all(axis=(1, 2)))
    tangents = noise.whiten(np.where(sound[:, None, None], slopes, 0.0))
    # the rows of R of a QR decomposition tell as much as all samples
    rows = np.array([np.linalg.qr(one.T, mode="r") for one in tangents])
    best = data.simulated(simulator, space.from_unit(unit[:1]))[0]
    value = float(np.sum(best * data.widths)) if isinstance(data, RateData) else float("nan")
    failed = int(np.count_nonzero(~sound))
    return Response(own, value, float("nan"), rows, np.zeros((len(unit), unit.shape[1])), failed)
