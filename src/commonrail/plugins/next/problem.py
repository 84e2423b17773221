"""Linear models of all candidates at all draws, with the errors that measurements share."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from commonrail.base.arrays import Bools, Floats
from commonrail.calibration.influence import around_position
from commonrail.calibration.space import Space
from commonrail.data.base import DataSet, widths_of
from commonrail.data.curves.data import RateData
from commonrail.data.quantities.data import QuantityData
from commonrail.data.simulator import Simulator
from commonrail.plugins.certainty.estimate import Estimate
from commonrail.plugins.certainty.likelihood import Likelihood, central_slopes, prior_slopes_at
from commonrail.plugins.certainty.noise_fit import Block, FittedNoise, block_of
from commonrail.plugins.next.study import Candidate, Criterion, Problem, place_of, planned

# Information on a position that is known to lie between its bounds and no more: a uniform distribution has the
# variance 1/12.
BOUNDED = 12.0


def prior_information(likelihood: Likelihood, unit: Floats) -> Floats:
    """Information (d, d) of priors and bounds on the positions, at a position (d,)."""
    pulls = prior_slopes_at(likelihood, unit)
    return np.asarray(pulls.T @ pulls + BOUNDED * np.eye(len(unit)))


def slope_weights(estimate: Estimate) -> Floats:
    """Information of an innovation (n,) of each value's law over that of the Gaussian one."""
    likelihood, found = estimate.likelihood, np.ones(estimate.likelihood.size)
    innovations = likelihood.whiten(estimate.errors)
    for block, noise in zip(likelihood.blocks, likelihood.noises, strict=True):
        found[block.rows] = max(float(noise.density.slope(innovations[block.rows]).mean()), 0.05)
    return found


# Errors that measurements share: what the model cannot do, beside the uncertain quantities among the parameters.
#
# Each is a load of unit variance on the values, made and planned alike. Loads become further unknowns with unit prior
# information, see `criteria`; those of a single curve are part of its covariance instead.

KEPT = 0.999  # share of a discrepancy's variance that its loads hold


def has_discrepancy(block: Block) -> bool:
    """True if a data set states a discrepancy that is correlated."""
    return bool(block.noise.discrepancy and block.noise.length)


def common_loads(block: Block, places: Floats) -> Floats:
    """Loads (k, n + c) of a map's stated discrepancy on its n values and on values at c other places.

    Places (c, 2) are energising times [s] and rail pressures [Pa].
    """
    both = np.concatenate([block.places, places])
    loads = replace(block, rows=slice(0, len(both)), places=both).stated_courses()
    weight = np.sum(loads**2, axis=1)
    order = np.argsort(-weight, kind="stable")
    n = int(np.searchsorted(np.cumsum(weight[order]), KEPT * weight.sum())) + 1
    return np.asarray(loads[order[:n]])


def decorrelated(tangents: Floats, block: Block, noise: FittedNoise) -> Floats:
    """Derivatives (…, n) of a curve, whitened by the noise alone, with its stated discrepancy as part of the noise."""
    loads = noise.whiten(block.stated_courses())
    if not len(loads):
        return tangents
    root = np.linalg.cholesky(np.eye(tangents.shape[-1]) + loads.T @ loads)
    flat = tangents.reshape(-1, tangents.shape[-1])
    return np.asarray(np.linalg.solve(root, flat.T).T.reshape(tangents.shape))


# Predictions of measurements that are not made yet, and their derivatives at draws of the parameters.


class Response(NamedTuple):
    """Measurement that could be made, as a linear model at each draw.

    `value` is the quantity at the most likely values [m³], NaN where that is not the kind's value or the simulation
    failed; `scale` the unit of the rows, for a quantity its tolerance [m³], NaN for a curve. `rows` (s, r, d) are
    derivatives of the whitened values with respect to the positions, zero at the `failed` draws; `plain` (s, d) are
    derivatives of a quantity in tolerances, zero for a curve.
    """

    candidate: Candidate
    value: float
    scale: float
    rows: Floats
    plain: Floats
    failed: int


class Responder(NamedTuple):
    """Simulation of candidates at positions (s, d), the most likely first; the simulator has the space's parameters."""

    simulator: Simulator
    space: Space
    unit: Floats

    @property
    def best(self) -> Floats:
        """Most likely values (1, d) [SI]."""
        return self.space.from_unit(self.unit[:1])

    def of(
        self, candidates: Sequence[Candidate], data: Sequence[DataSet], noises: Mapping[str, FittedNoise]
    ) -> list[Response]:
        """Responses of candidates, in order; `noises` are those of a measurement of each kind."""
        found: dict[int, Response] = {}
        for kind in dict.fromkeys(one.kind for one in candidates):
            which = [i for i, one in enumerate(candidates) if one.kind == kind]
            group = [candidates[i] for i in which]
            sets = planned(kind, [one.point for one in group], data)
            if isinstance(sets[0], QuantityData):
                made = self._of_map(group, sets[0], noises[kind])
            else:
                made = [self._of_curve(c, one, noises[kind]) for c, one in zip(group, sets, strict=True)]
            found |= dict(zip(which, made, strict=True))
        return [found[i] for i in range(len(candidates))]

    def _slopes(self, data: DataSet) -> Floats:
        """Derivatives (s, d, n) of the residuals by positions, from differences to both sides; NaN where one failed."""
        near = [around_position(self.space, one) for one in self.unit]
        points = np.concatenate([one.values[1:] for one in near])
        found = data.residuals(data.simulated(self.simulator, points)).reshape(len(near), 2, self.unit.shape[1], -1)
        return np.asarray((found[:, 1] - found[:, 0]) / np.array([one.width for one in near])[..., None])

    def _of_map(self, candidates: Sequence[Candidate], data: QuantityData, noise: FittedNoise) -> list[Response]:
        best = data.simulated(self.simulator, self.best)[0]
        data = replace(data, quantity=np.maximum(np.where(np.isfinite(best), best, 0.0), 0.0))
        tolerance = data.absolute + data.relative * data.quantity
        slopes = self._slopes(data)
        sound = np.asarray(np.isfinite(slopes).all(axis=1) & np.isfinite(best))  # (s, n)
        plain = np.where(sound[:, None], slopes, 0.0)
        rows = plain / noise.scale
        failed = np.count_nonzero(~sound, axis=0)
        return [
            Response(one, float(best[i]), float(tolerance[i]), rows[:, None, :, i], plain[..., i], int(failed[i]))
            for i, one in enumerate(candidates)
        ]

    def _of_curve(self, candidate: Candidate, data: DataSet, noise: FittedNoise) -> Response:
        slopes = self._slopes(data)
        sound: Bools = np.asarray(np.isfinite(slopes).all(axis=(1, 2)))
        best = data.simulated(self.simulator, self.best)[0]
        noise = noise.at(data.residual_scale * np.nan_to_num(best))
        tangents = decorrelated(noise.whiten(np.where(sound[:, None, None], slopes, 0.0)), block_of(data, 0), noise)
        # the rows of R of a QR decomposition tell as much as all samples
        rows = np.array([np.linalg.qr(one.T, mode="r") for one in tangents])
        value = float(np.sum(best * widths_of(data))) if isinstance(data, RateData) else float("nan")
        failed = int(np.count_nonzero(~sound))
        return Response(candidate, value, float("nan"), rows, np.zeros(self.unit.shape), failed)


def problem_of(
    found: Estimate,
    likelihood: Likelihood,
    data: Sequence[DataSet],
    unit: Floats,
    responses: Sequence[Response],
    aim: tuple[Criterion, Sequence[int], int, int],
) -> Problem:
    """Problem of design about draws (s, d), of candidates with these responses.

    The unknowns are the positions and the loads of stated discrepancies. Data sets are in the order of the likelihood's
    blocks, whose noise is taken for granted. The aim is the criterion, the columns of the parameters that it is about,
    the number of parameters that a prediction depends on: those of the bench, which follow, do not act on it; and the
    number of responses, the first ones, that are predicted.
    """
    loads, planned = _discrepancies(likelihood, data, responses)
    rows = _rows(responses, planned, [likelihood.noises[_first(data, one)].scale for one in responses])
    s, d, size = len(unit), unit.shape[1], rows.shape[-1]
    slopes = central_slopes(likelihood, unit)
    tangents = likelihood.whiten(np.concatenate([slopes, np.repeat(loads[None], s, axis=0)], axis=1))
    information = (tangents * slope_weights(found)) @ tangents.transpose(0, 2, 1)
    information += np.diag(np.concatenate([np.zeros(d), np.ones(size - d)]))
    information[:, :d, :d] += np.array([prior_information(likelihood, at) for at in unit])
    return Problem(aim[0], information, rows, _aims(found, responses[: aim[3]], planned, size, aim))


def _first(data: Sequence[DataSet], response: Response) -> int:
    """Number of the first data set of a candidate's kind."""
    return next(i for i, one in enumerate(data) if one.kind == response.candidate.kind)


def _discrepancies(
    likelihood: Likelihood, data: Sequence[DataSet], responses: Sequence[Response]
) -> tuple[Floats, Floats]:
    """Loads (k, n) of the maps' discrepancies on the data, and on the candidates (k, c)."""
    made, planned = [np.zeros((0, likelihood.size))], [np.zeros((0, len(responses)))]
    places = np.array([place_of(one.candidate.point)[1::-1] for one in responses])
    first = np.array([_first(data, one) for one in responses])
    for i, block in enumerate(likelihood.blocks):
        if block.ordered or not has_discrepancy(block):
            continue
        which = np.flatnonzero(first == i)
        both = common_loads(block, places[which])
        of_data, of_candidates = (np.zeros((len(both), n)) for n in (likelihood.size, len(responses)))
        of_data[:, block.rows], of_candidates[:, which] = both[:, : block.size], both[:, block.size :]
        made.append(of_data)
        planned.append(of_candidates)
    return np.vstack(made), np.vstack(planned)


def _rows(responses: Sequence[Response], planned: Floats, scales: Sequence[float]) -> Floats:
    """Whitened derivatives (s, c, r, D) of the candidates."""
    s, _, size = responses[0].rows.shape
    most = max(one.rows.shape[1] for one in responses)
    rows = np.zeros((s, len(responses), most, size + len(planned)))
    for i, one in enumerate(responses):
        n = one.rows.shape[1]
        rows[:, i, :n, :size] = one.rows
        if math.isfinite(one.scale):
            sound: Bools = np.asarray(one.rows.any(axis=(1, 2)))[:, None]
            rows[:, i, 0, size:] = np.where(sound, planned[:, i] / scales[i], 0.0)
    return rows


def _aims(
    found: Estimate,
    responses: Sequence[Response],
    planned: Floats,
    size: int,
    aim: tuple[Criterion, Sequence[int], int, int],
) -> Floats:
    """Rows (s, k, D): named parameters relative to their values, or predictions in tolerances.

    A prediction is that of the real injector: model and discrepancy. Where no candidate is a quantity, the samples of
    the curves are predicted, in units of their noise.
    """
    s, d = responses[0].plain.shape
    own = np.arange(d) < aim[2]
    if aim[0] is not Criterion.V:
        relative = found.likelihood.scaled(found.unit) / np.maximum(np.abs(found.point), 1e-300)
        wide = np.zeros((len(aim[1]), size))
        wide[:, :d] = (np.eye(d) * relative)[list(aim[1])]
        return np.repeat(wide[None], s, axis=0)
    maps = [i for i, one in enumerate(responses) if math.isfinite(one.scale)]
    if maps:
        aims = np.zeros((s, len(maps), size))
        aims[:, :, :d] = np.stack([responses[i].plain for i in maps], axis=1) * own
        aims[:, :, size - len(planned) :] = planned[:, maps].T
        return aims
    curves = np.concatenate([one.rows[..., :d] for one in responses], axis=1) * own
    return np.concatenate([curves, np.zeros((*curves.shape[:2], size - d))], axis=2)
