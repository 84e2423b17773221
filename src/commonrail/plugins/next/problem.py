"""Linear model of all candidates around the draws of a fit, including errors that measurements share."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.data.base import DataSet, value_widths
from commonrail.data.curves.data import RateData
from commonrail.data.quantities.data import QuantityData
from commonrail.data.simulator import Simulator
from commonrail.plugins.certainty.estimate import Estimate, bounded
from commonrail.plugins.certainty.likelihood import Likelihood
from commonrail.plugins.certainty.noise_fit import Block, FittedNoise, block_of
from commonrail.plugins.next.settings import Criterion
from commonrail.plugins.next.study import Candidate, Problem, locate, plan_data_sets

KEPT = 0.999  # share of a discrepancy's variance that its components represent
FIRM = 1e-12  # added to the variances of positions, because a combination of positions may have no variance


class Response(NamedTuple):
    """Values of a candidate as a linear function of the parameters, as positions between the bounds."""

    candidate: Candidate
    value: float  # mean quantity over the draws [m³], NaN if not defined or most simulations failed
    scale: float  # tolerance of a quantity [m³], NaN for a curve
    rows: Floats  # (r, d), derivatives of the whitened values with respect to the positions
    plain: Floats  # (d,), derivatives of a quantity in tolerances, zero for a curve
    failed: int  # simulations


def regress(unit: Floats, values: Floats) -> Floats:
    """Regress values (m, n) on positions (m, d) of the draws: derivatives (d, n)."""
    return np.asarray(np.linalg.lstsq(unit - unit.mean(axis=0), values - values.mean(axis=0), rcond=None)[0])


def simulate_responses(
    candidates: Sequence[Candidate],
    data: Sequence[DataSet],
    noises: Mapping[str, FittedNoise],
    simulator: Simulator,
    points: Floats,
    unit: Floats,
) -> list[Response]:
    """Simulate the candidates at draws (m, d) and linearise them, in order.

    `points` [SI] and `unit` (positions between bounds) are the draws; `noises`: noise of each kind of measurement. A
    candidate that fails at most of the draws gets zero derivatives.
    """
    responses: dict[int, Response] = {}
    for kind in dict.fromkeys(candidate.kind for candidate in candidates):
        places = [i for i, candidate in enumerate(candidates) if candidate.kind == kind]
        sets = plan_data_sets(kind, [candidates[i].point for i in places], data)
        if isinstance(sets[0], QuantityData):
            simulated = sets[0].simulated(simulator, points).T
            for i, values in zip(places, simulated, strict=True):
                responses[i] = _quantity(candidates[i], sets[0], noises[kind], values, unit)
        else:
            for i, curve in zip(places, sets, strict=True):
                responses[i] = _curve(candidates[i], curve, noises[kind], curve.simulated(simulator, points), unit)
    return [responses[i] for i in range(len(candidates))]


def _quantity(candidate: Candidate, data: QuantityData, noise: FittedNoise, values: Floats, unit: Floats) -> Response:
    """Response of a quantity, simulated at the draws (m,)."""
    sound = np.isfinite(values)
    failed = int(np.count_nonzero(~sound))
    if 2 * failed > len(unit):
        return _silent(candidate, data.absolute, unit.shape[1], failed)
    value = max(float(values[sound].mean()), 0.0)
    tolerance = data.absolute + data.relative * value
    plain = regress(unit[sound], values[sound, None] / tolerance)[:, 0]
    return Response(candidate, value, tolerance, plain[None] / noise.scale, plain, failed)


def _curve(candidate: Candidate, data: DataSet, noise: FittedNoise, values: Floats, unit: Floats) -> Response:
    """Response of a curve, simulated at the draws (m, n)."""
    sound = np.isfinite(values).all(axis=1)
    failed = int(np.count_nonzero(~sound))
    if 2 * failed > len(unit):
        return _silent(candidate, math.nan, unit.shape[1], failed)
    mean = values[sound].mean(axis=0)
    noise = noise.at(data.residual_scale * mean)
    slopes = regress(unit[sound], data.residuals(values[sound]))
    tangents, loads = noise.whiten(slopes), noise.whiten(block_of(data, 0).stated_courses())
    if len(loads):  # the stated discrepancy of the curve
        root = np.linalg.cholesky(np.eye(tangents.shape[-1]) + loads.T @ loads)
        tangents = np.asarray(np.linalg.solve(root, tangents.T).T)
    # the rows of R of a QR decomposition tell as much as all samples
    value = float(np.sum(mean * value_widths(data))) if isinstance(data, RateData) else math.nan
    rows = np.asarray(np.linalg.qr(tangents.T, mode="r"), float)
    return Response(candidate, value, math.nan, rows, np.zeros(unit.shape[1]), failed)


def _silent(candidate: Candidate, scale: float, d: int, failed: int) -> Response:
    """Response with zero derivatives, for a candidate that fails at most of the draws."""
    return Response(candidate, math.nan, scale, np.zeros((1, d)), np.zeros(d), failed)


def build_problem(
    criterion: Criterion,
    estimate: Estimate,
    likelihood: Likelihood,
    draws: Floats,
    data: Sequence[DataSet],
    responses: Sequence[Response],
    parameters: Sequence[int],
    injector_count: int,
    predicted: int,
) -> Problem:
    """Build the design problem about draws (m, d) of a fit.

    Unknowns are the positions, with the covariance of the draws, and the weights of the stated discrepancies'
    components. Data sets are in the order of the blocks of `likelihood`, whose noise is taken as known.

    `parameters`: columns for criteria D and A; `injector_count`: number of leading parameters that belong to the
    injector, since predictions do not depend on the bench; `predicted`: number of leading responses for criterion V.
    """
    loads, planned_loads = _discrepancies(likelihood, data, responses)
    d, size = draws.shape[1], draws.shape[1] + len(loads)
    tangents = likelihood.whiten(np.vstack([estimate.slopes, loads]))
    innovations, slope_weights = estimate.likelihood.whiten(estimate.errors), np.ones(likelihood.size)
    for block, noise in estimate.likelihood.pairs:  # information of each noise law relative to a Gaussian
        slope_weights[block.rows] = noise.mean_slope(innovations[block.rows])
    joint = (tangents * slope_weights) @ tangents.T
    crossed, of_loads = joint[:d, d:], joint[d:, d:] + np.eye(len(loads))
    information = np.zeros((size, size))
    information[:d, :d] = np.linalg.inv(bounded(np.cov(draws.T).reshape(d, d)) + FIRM * np.eye(d))
    if len(loads):  # keeps the marginal covariance of the positions equal to the covariance of the draws
        information[:d, :d] += crossed @ np.linalg.solve(of_loads, crossed.T)
        information[:d, d:], information[d:, :d] = crossed, crossed.T
        information[d:, d:] = of_loads
    rows = np.zeros((len(responses), max(len(response.rows) for response in responses), size))
    for i, response in enumerate(responses):
        rows[i, : len(response.rows), :d] = response.rows
        if math.isfinite(response.scale) and response.rows.any():
            rows[i, 0, d:] = planned_loads[:, i] / likelihood.noises[_first(data, response)].scale
    if criterion is Criterion.V:
        aims = _predictions(responses[:predicted], planned_loads, rows, d, injector_count)
    else:
        relative = estimate.likelihood.scaled(estimate.unit) / np.maximum(np.abs(estimate.point), 1e-300)
        aims = (np.eye(size)[:d] * relative[:, None])[list(parameters)]
    return Problem(criterion, information, rows, aims)


def _predictions(responses: Sequence[Response], loads: Floats, rows: Floats, d: int, injector_count: int) -> Floats:
    """Rows (k, D) that predict the real injector, model plus discrepancy, in tolerances.

    If no candidate is a quantity, the samples of the curves are predicted, in units of their noise.
    """
    maps = [i for i, response in enumerate(responses) if math.isfinite(response.scale)]
    if not maps:
        aims = rows[: len(responses)].reshape(-1, rows.shape[-1]) * (np.arange(rows.shape[-1]) < injector_count)
        return np.asarray(aims[aims.any(axis=1)])
    aims = np.zeros((len(maps), rows.shape[-1]))
    aims[:, :injector_count] = [responses[i].plain[:injector_count] for i in maps]
    aims[:, d:] = loads[:, maps].T
    return aims


# A discrepancy of the model is an error shared by measurements: loads of unit variance on measured and planned values,
# which are further unknowns with unit prior information. Loads of a single curve belong to its covariance instead.


def has_discrepancy(block: Block) -> bool:
    """True if a data set states a correlated discrepancy."""
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


def _first(data: Sequence[DataSet], response: Response) -> int:
    """Index of the first data set of a candidate's kind."""
    return next(i for i, data_set in enumerate(data) if data_set.kind == response.candidate.kind)


def _discrepancies(
    likelihood: Likelihood, data: Sequence[DataSet], responses: Sequence[Response]
) -> tuple[Floats, Floats]:
    """Loads (k, n) of the maps' discrepancies on the data, and on the candidates (k, c)."""
    of_data, of_candidates = [np.zeros((0, likelihood.size))], [np.zeros((0, len(responses)))]
    places = np.array([locate(response.candidate.point)[1::-1] for response in responses])
    first = np.array([_first(data, response) for response in responses])
    for i, block in enumerate(likelihood.blocks):
        if block.ordered or not has_discrepancy(block):
            continue
        columns = np.flatnonzero(first == i)
        both = common_loads(block, places[columns])
        measured, candidates = np.zeros((len(both), likelihood.size)), np.zeros((len(both), len(responses)))
        measured[:, block.rows], candidates[:, columns] = both[:, : block.size], both[:, block.size :]
        of_data.append(measured)
        of_candidates.append(candidates)
    return np.vstack(of_data), np.vstack(of_candidates)
