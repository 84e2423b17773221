"""Decay of the flux that pulls the armature: eddy currents hold a falling flux for another time than a rising one.

dφ_f/dt = (φ − φ_f)/τ, with τ the solenoid's `eddy_lag` while φ_f rises and the `lag` below while it falls. A
saturated iron that is magnetised and one that is released differ in their permeability, hence in their eddy currents;
the two constants are lumped ones. Not in the paper.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from commonrail.physics.law import physics
from commonrail.physics.parameters import Domain, Q


class Parameters(NamedTuple):
    """Lag of a falling flux."""

    lag: Annotated[
        float,
        Q("s", "lag of the pulling flux while it falls (0: none)", Domain.NON_NEGATIVE, 0.0, usual=(1e-6, 1e-3)),
    ]


@physics
def lagged(flux: float, pulling: float, rising: float, falling: float) -> float:
    """Pulling flux φ_f [Wb] after a step.

    `flux`: φ, mean over the step [Wb]; `pulling`: φ_f before the step [Wb]; `rising`, `falling`: share of the
    difference that a step makes up, 1 − exp(−dt/τ), for either direction [1].
    """
    ahead = flux - pulling
    return pulling + (rising if ahead > 0.0 else falling) * ahead


@physics
def rate(flux: float, pulling: float, rising: float, falling: float) -> float:
    """dφ_f/dt [V], for a solver that has both fluxes at one time.

    `flux`, `pulling`: φ and φ_f [Wb]; `rising`, `falling`: lags τ of either direction [s], > 0.
    """
    ahead = flux - pulling
    return ahead / (rising if ahead > 0.0 else falling)
