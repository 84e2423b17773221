"""Errors that measurements share: uncertain quantities of the bench, and what the model cannot do.

Each is a load of unit variance on the values, made and planned alike. Loads become further unknowns with unit prior
information, see `criteria`; those of a single curve are part of its covariance instead.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from commonrail.analysis.certainty.block import Block, FittedNoise
from commonrail.analysis.certainty.nuisance import nuisances_of
from commonrail.arrays import Floats
from commonrail.calibration.objective import Objective
from commonrail.kinds import DataSet
from commonrail.kinds.simulator import Simulator

__all__ = ["bench_loads", "common_loads", "decorrelated"]


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
