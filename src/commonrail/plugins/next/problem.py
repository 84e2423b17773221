"""Linear models of all candidates at all draws, with the errors that measurements share."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from commonrail.base.arrays import Bools, Floats
from commonrail.calibration.objective import Objective
from commonrail.calibration.optimisers.least_squares import FeasibleSet
from commonrail.calibration.space import Space
from commonrail.data.base import DataSet, widths_of
from commonrail.data.curves.data import RateData
from commonrail.data.quantities.data import QuantityData
from commonrail.data.simulator import Simulator
from commonrail.plugins.certainty.estimate import Estimate
from commonrail.plugins.certainty.likelihood import Likelihood
from commonrail.plugins.certainty.noise import Block, FittedNoise, block_of
from commonrail.plugins.certainty.nuisance import nuisances_of
from commonrail.plugins.next.study import Candidate, Criterion, Problem, place_of, planned

# Draws of the parameters that the data leave open, so that a plan does not depend on one point estimate.

# Information on a position that is known to lie between its bounds and no more: a uniform distribution has the
# variance 1/12.
BOUNDED = 12.0


def prior_information(likelihood: Likelihood, unit: Floats) -> Floats:
    """Information (d, d) of priors and bounds on the positions, at a position (d,)."""
    pulls = likelihood.prior_slopes(unit)
    return np.asarray(pulls.T @ pulls + BOUNDED * np.eye(len(unit)))


def slope_weights(estimate: Estimate) -> Floats:
    """Information of an innovation (n,) of each value's law over that of the Gaussian one."""
    own, found = estimate.likelihood, np.ones(estimate.likelihood.size)
    innovations = own.whiten(estimate.errors)
    for block, noise in zip(own.blocks, own.noises, strict=True):
        found[block.rows] = max(float(noise.density.slope(innovations[block.rows]).mean()), 0.05)
    return found


def laplace_draws(estimate: Estimate, many: int, seed: int) -> Floats:
    """Positions (s, d): the most likely ones, then draws of the normal distribution that the curvature there gives.

    Draws beyond bounds and constraints are pulled back to them.

    Parameters
    ----------
    estimate : Estimate
    many : int
    seed : int
    """
    own, unit = estimate.likelihood, estimate.unit
    tangents = own.whiten(estimate.slopes)
    information = (tangents * slope_weights(estimate)) @ tangents.T + prior_information(own, unit)
    moves = estimate.covariance.nuisances
    covariance = np.linalg.inv(information) + np.where(np.isfinite(moves), moves, 0.0).T @ moves
    normal = np.random.default_rng(seed).standard_normal((many - 1, len(unit)))
    drawn = unit + normal @ np.linalg.cholesky(covariance).T
    inside = FeasibleSet.of(own.space).within(np.repeat(unit[None], many - 1, axis=0), drawn)
    return np.vstack([unit, inside])


def posterior_draws(estimate: Estimate, points: Floats, many: int, seed: int) -> Floats:
    """Positions (s, d): the most likely ones, then draws from the posterior, none twice.

    Parameters
    ----------
    estimate : Estimate
    points : (m, d)
        Drawn from the posterior [SI].
    many : int
        Largest number s.
    seed : int
        Of the choice among them.
    """
    chosen = np.random.default_rng(seed).permutation(len(points))[: many - 1]
    return np.vstack([estimate.unit, estimate.likelihood.space.to_unit(points[chosen])])


# Errors that measurements share: uncertain quantities of the bench, and what the model cannot do.
#
# Each is a load of unit variance on the values, made and planned alike. Loads become further unknowns with unit prior
# information, see `criteria`; those of a single curve are part of its covariance instead.

KEPT = 0.999  # share of a discrepancy's variance that its loads hold


def bench_loads(data: DataSet, simulator: Simulator, point: Floats, names: Sequence[str]) -> Floats:
    """Changes (m, n) of a data set's residuals for one standard deviation of each uncertain quantity.

    Parameters
    ----------
    data : DataSet
    simulator : Simulator
    point : (d,)
        [SI].
    names : sequence of str
        Of the quantities, as `Nuisance.name`; one that has no effect on the data set has zeros.
    """
    n = len(data.measured)
    if not names:
        return np.zeros((0, n))
    objective = Objective(
        simulator.injector,
        simulator.names,
        [data],
        simulator.time_step,
        simulator.threads,
        same_bits=simulator.same_bits,
    )
    found = {one.name: one.shift(point) for one in nuisances_of(objective, np.ones(n))}
    return np.array([found.get(name, np.zeros(n)) for name in names])


def common_loads(block: Block, places: Floats) -> Floats:
    """Loads (k, n + c) of a map's stated discrepancy on its n values and on values at other places.

    Parameters
    ----------
    block : Block
        Of the map.
    places : (c, 2)
        Energising times [s] and rail pressures [Pa].
    """
    both = np.concatenate([block.places, places])
    loads = replace(block, rows=slice(0, len(both)), places=both).stated_courses()
    weight = np.sum(loads**2, axis=1)
    order = np.argsort(-weight, kind="stable")
    many = int(np.searchsorted(np.cumsum(weight[order]), KEPT * weight.sum())) + 1
    return np.asarray(loads[order[:many]])


def decorrelated(tangents: Floats, block: Block, noise: FittedNoise) -> Floats:
    """Whitened derivatives (…, n) of a curve, with its stated discrepancy as part of the noise.

    Parameters
    ----------
    tangents : (…, n)
        Whitened by the noise alone.
    block : Block
    noise : FittedNoise
    """
    loads = noise.whiten(block.stated_courses())
    if not len(loads):
        return tangents
    root = np.linalg.cholesky(np.eye(tangents.shape[-1]) + loads.T @ loads)
    flat = tangents.reshape(-1, tangents.shape[-1])
    return np.asarray(np.linalg.solve(root, flat.T).T.reshape(tangents.shape))


# Predictions of measurements that are not made yet, and their derivatives at draws of the parameters.

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
        value = float(np.sum(best * widths_of(data))) if isinstance(data, RateData) else float("nan")
        failed = int(np.count_nonzero(~sound))
        return Response(own, value, float("nan"), rows, np.zeros(self.unit.shape), failed)


def problem_of(
    found: Estimate,
    likelihood: Likelihood,
    data: Sequence[DataSet],
    unit: Floats,
    responses: Sequence[Response],
    aim: tuple[Criterion, Sequence[int]],
) -> Problem:
    """Problem of design about draws.

    The unknowns are the positions, the uncertain quantities of the bench, and the loads of stated discrepancies.

    Parameters
    ----------
    found : Estimate
    likelihood : Likelihood
        With the noise that is taken for granted.
    data : sequence of DataSet
        In the order of the likelihood's blocks.
    unit : (s, d)
        Draws.
    responses : sequence of Response
        Of the candidates.
    aim : (Criterion, sequence of int)
        Criterion, and the columns of the parameters that it is about.
    """
    loads, planned = _discrepancies(likelihood, data, responses)
    rows = _rows(responses, planned, [likelihood.noises[_first(data, one)].scale for one in responses])
    s, d, size = len(unit), unit.shape[1], rows.shape[-1]
    shared = np.vstack([found.shifts, loads])
    slopes = likelihood.jacobian(unit)
    both = np.concatenate([slopes, np.repeat(shared[None], s, axis=0)], axis=1)
    tangents = _whitened(likelihood, both)
    information = (tangents * slope_weights(found)) @ tangents.transpose(0, 2, 1)
    information += np.diag(np.concatenate([np.zeros(d), np.ones(size - d)]))
    information[:, :d, :d] += np.array([prior_information(likelihood, at) for at in unit])
    return Problem(aim[0], information, rows, _aims(found, responses, planned, size, aim))


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
        if block.ordered or not (block.noise.discrepancy and block.noise.length):
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
        own = one.rows.shape[1]
        rows[:, i, :own, :size] = one.rows
        if math.isfinite(one.scale):
            sound: Bools = np.asarray(one.rows.any(axis=(1, 2)))[:, None]
            rows[:, i, 0, size:] = np.where(sound, planned[:, i] / scales[i], 0.0)
    return rows


def _whitened(likelihood: Likelihood, slopes: Floats) -> Floats:
    """Whitened derivatives of the data, discrepancies of curves among their noise."""
    tangents = likelihood.whiten(slopes)
    for block, noise in zip(likelihood.blocks, likelihood.noises, strict=True):
        if block.ordered:
            tangents[..., block.rows] = decorrelated(tangents[..., block.rows], block, noise)
    return tangents


def _aims(
    found: Estimate,
    responses: Sequence[Response],
    planned: Floats,
    size: int,
    aim: tuple[Criterion, Sequence[int]],
) -> Floats:
    """Rows (s, k, D): named parameters relative to their values, or predictions in tolerances.

    A prediction is that of the real injector: model and discrepancy. Where no candidate is a quantity, the samples of
    the curves are predicted, in units of their noise.
    """
    s, d = responses[0].plain.shape
    if aim[0] is not Criterion.V:
        relative = found.likelihood.scaled(found.unit) / np.maximum(np.abs(found.point), 1e-300)
        wide = np.zeros((len(aim[1]), size))
        wide[:, :d] = (np.eye(d) * relative)[list(aim[1])]
        return np.repeat(wide[None], s, axis=0)
    maps = [i for i, one in enumerate(responses) if math.isfinite(one.scale)]
    if maps:
        aims = np.zeros((s, len(maps), size))
        aims[:, :, :d] = np.stack([responses[i].plain for i in maps], axis=1)
        aims[:, :, size - len(planned) :] = planned[:, maps].T
        return aims
    curves = np.concatenate([one.rows[..., :d] for one in responses], axis=1)
    return np.concatenate([curves, np.zeros((*curves.shape[:2], size - d))], axis=2)
