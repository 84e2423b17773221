"""Linear models of all candidates at all draws, with the errors that measurements share."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from commonrail.analysis.certainty.estimate import Estimate
from commonrail.analysis.certainty.likelihood import Likelihood
from commonrail.analysis.design.candidates import place_of
from commonrail.analysis.design.criteria import Criterion, Problem
from commonrail.analysis.design.draws import prior_information, slope_weights
from commonrail.analysis.design.responses import Response
from commonrail.analysis.design.shared import common_loads, decorrelated
from commonrail.arrays import Bools, Floats
from commonrail.kinds import DataSet

__all__ = ["problem_of"]


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
