"""How long a time step the plunger–needle chain bears."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from commonrail.injector.definition import Injector, parameter_paths
from commonrail.injector.variants import Body

Floats = NDArray[np.float64]


def chain_matrices(k: Floats, masses: Floats, joint: float) -> tuple[Floats, Floats]:
    """Stiffness matrix [N/m] and nodal masses [kg] of the nine-mass chain in contact, Eq. (10).

    Parameters
    ----------
    k, masses : (7,)
        Stiffness and mass of the cylinders.
    joint : float
        Contact stiffness between masses 6 and 7.
    """
    springs = np.array([*k[:5], joint, *k[5:]])
    matrix = np.diag(np.append(springs, 0.0) + np.append(0.0, springs))
    matrix -= np.diag(springs, 1) + np.diag(springs, -1)
    plunger, needle = masses[:5], masses[5:]
    half = [np.append(part, 0.0) / 2 + np.append(0.0, part) / 2 for part in (plunger, needle)]
    return matrix, np.concatenate(half)


def longest_step(injector: Injector, theta: Floats) -> float:
    """Stability limit 2/ω_max of the leapfrog step [s], seat and stop in contact.

    Parameters
    ----------
    theta : (parameters, …)
        Flat parameter vector of one candidate.
    """
    value = dict(zip(parameter_paths(), theta.tolist(), strict=False))
    needle = {name: value[f"plunger_needle.{name}"] for name in ("joint_stiffness", "stop_stiffness")}
    k = np.array([value[f"plunger_needle.k{i}"] for i in range(1, 8)])
    masses = np.array([value[f"plunger_needle.m{i}"] for i in range(1, 8)])
    seat = value["needle_seat.contact_stiffness"]
    if injector.variant.body is Body.RIGID:
        return float(2.0 / np.sqrt(max(seat, needle["stop_stiffness"]) / masses.sum()))
    matrix, nodes = chain_matrices(k, masses, needle["joint_stiffness"])
    matrix[0, 0] += needle["stop_stiffness"]
    matrix[8, 8] += seat
    scale = 1.0 / np.sqrt(nodes)
    with np.errstate(over="ignore", invalid="ignore"):
        scaled = matrix * np.outer(scale, scale)
    if not np.isfinite(scaled).all():
        return 0.0  # beyond numbers: no step is short enough
    return float(2.0 / np.sqrt(np.linalg.eigvalsh(scaled).max()))
