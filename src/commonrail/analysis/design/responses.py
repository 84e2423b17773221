"""Predictions of measurements that are not made yet, and their derivatives at draws of the parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from commonrail.analysis.certainty.block import FittedNoise, block_of
from commonrail.analysis.design.candidates import Candidate, planned
from commonrail.analysis.design.shared import bench_loads, decorrelated
from commonrail.arrays import Bools, Floats
from commonrail.calibration.space import Space
from commonrail.kinds import DataSet, QuantityData, RateData
from commonrail.kinds.simulator import Simulator

__all__ = ["STEP", "Responder", "Response", "slopes_of"]


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
    rows : (s, r, d + m)
        Derivatives of the whitened values with respect to the positions, then their changes for one standard deviation
        of each uncertain quantity of the bench; zero at draws that fail.
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


class Responder(NamedTuple):
    """Simulation of candidates.

    Attributes
    ----------
    simulator : Simulator
        Of the parameters of the space.
    space : Space
    unit : (s, d)
        Draws, the most likely positions first.
    uncertain : tuple of str
        Names of the uncertain quantities of the bench.
    """

    simulator: Simulator
    space: Space
    unit: Floats
    uncertain: tuple[str, ...] = ()

    @property
    def best(self) -> Floats:
        """Most likely values (1, d) [SI]."""
        return self.space.from_unit(self.unit[:1])

    def of(
        self, candidates: Sequence[Candidate], data: Sequence[DataSet], noises: Mapping[str, FittedNoise]
    ) -> list[Response]:
        """Responses of candidates, in order.

        Parameters
        ----------
        candidates : sequence of Candidate
        data : sequence of DataSet
            That there are.
        noises : mapping of str to FittedNoise
            Noise of a measurement of each kind.
        """
        found: dict[int, Response] = {}
        for kind in dict.fromkeys(one.kind for one in candidates):
            which = [i for i, one in enumerate(candidates) if one.kind == kind]
            own = [candidates[i] for i in which]
            sets = planned(kind, [one.point for one in own], data)
            if isinstance(sets[0], QuantityData):
                made = self._of_map(own, sets[0], noises[kind])
            else:
                made = [self._of_curve(c, one, noises[kind]) for c, one in zip(own, sets, strict=True)]
            found |= dict(zip(which, made, strict=True))
        return [found[i] for i in range(len(candidates))]

    def _slopes(self, data: DataSet) -> Floats:
        return slopes_of(lambda points: data.residuals(data.simulated(self.simulator, points)), self.space, self.unit)

    def _with_loads(self, data: DataSet, slopes: Floats) -> Floats:
        """Derivatives (s, d + m, n), those of the uncertain quantities below the others."""
        loads = bench_loads(data, self.simulator, self.best[0], self.uncertain)
        return np.concatenate([slopes, np.repeat(loads[None], len(slopes), axis=0)], axis=1)

    def _of_map(self, own: Sequence[Candidate], data: QuantityData, noise: FittedNoise) -> list[Response]:
        best = data.simulated(self.simulator, self.best)[0]
        data = replace(data, quantity=np.maximum(np.where(np.isfinite(best), best, 0.0), 0.0))
        tolerance = data.absolute + data.relative * data.quantity
        slopes = self._slopes(data)
        sound = np.asarray(np.isfinite(slopes).all(axis=1) & np.isfinite(best))  # (s, n)
        plain = np.where(sound[:, None], slopes, 0.0)
        rows = np.where(sound[:, None], self._with_loads(data, plain), 0.0) / noise.scale
        failed = np.count_nonzero(~sound, axis=0)
        return [
            Response(one, float(best[i]), float(tolerance[i]), rows[:, None, :, i], plain[..., i], int(failed[i]))
            for i, one in enumerate(own)
        ]

    def _of_curve(self, own: Candidate, data: DataSet, noise: FittedNoise) -> Response:
        slopes = self._slopes(data)
        sound: Bools = np.asarray(np.isfinite(slopes).all(axis=(1, 2)))
        both = self._with_loads(data, np.where(sound[:, None, None], slopes, 0.0))
        best = data.simulated(self.simulator, self.best)[0]
        noise = replace(noise, growth=noise.growth.at(data.residual_scale * np.nan_to_num(best)))
        tangents = decorrelated(noise.whiten(np.where(sound[:, None, None], both, 0.0)), block_of(data, 0), noise)
        # the rows of R of a QR decomposition tell as much as all samples
        rows = np.array([np.linalg.qr(one.T, mode="r") for one in tangents])
        value = float(np.sum(best * data.widths)) if isinstance(data, RateData) else float("nan")
        failed = int(np.count_nonzero(~sound))
        return Response(own, value, float("nan"), rows, np.zeros(self.unit.shape), failed)
