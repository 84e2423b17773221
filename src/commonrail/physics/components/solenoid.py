"""Electromagnet of the electro-hydraulic valve, Eq. (11), (12).

Flux φ links N turns. The magnetomotive force N i drives it through n_g air gaps and the iron:

    N i = n_g l_a φ/(μ0 A_g) + l_s H_s(φ/A_g),    N dφ/dt = v − R i,    F_ev = n_g φ_f²/(2 μ0 A_g)

Eq. (11) prints one air gap, Eq. (12) two: their number n_g is a parameter here and enters both flux and
force. Eddy currents, which the paper neglects, delay the flux that pulls: dφ_f/dt = (φ − φ_f)/τ;
τ = 0 switches them off.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from commonrail.physics.law import Domain, Q, physics

MU0 = 4e-7 * math.pi  # magnetic constant [T m/A], its value of 1948-2019; today's differs by 5e-10


class Parameters(NamedTuple):
    """Coil and magnetic circuit."""

    turns: Annotated[float, Q("1", "turns of the coil")]
    resistance: Annotated[float, Q("ohm", "resistance of coil and leads", usual=(0.01, 20.0))]
    pole_area: Annotated[float, Q("m2", "pole area A_g of one air gap", usual=(2e-6, 2e-3))]
    residual_gap: Annotated[float, Q("m", "air gap left with the armature at its stop", usual=(2e-6, 1e-3))]
    air_gaps: Annotated[float, Q("1", "number of air gaps in series", Domain.POSITIVE, 2.0)]
    iron_length: Annotated[
        float, Q("m", "length of the flux path in iron l_s", Domain.NON_NEGATIVE, 0.04, usual=(2e-3, 1.0))
    ]
    permeability: Annotated[float, Q("1", "relative permeability of the iron, not saturated", Domain.POSITIVE, 2000.0)]
    knee_flux_density: Annotated[float, Q("T", "flux density at which H_s has doubled", Domain.POSITIVE, 1.4)]
    eddy_lag: Annotated[
        float,
        Q("s", "lag of the pulling flux by eddy currents (0: none)", Domain.NON_NEGATIVE, 0.0, usual=(1e-6, 1e-3)),
    ]


class Coefficients(NamedTuple):
    """Reluctance per gap length [A/(Wb m)], iron line [A/Wb], knee [1/Wb²], force [N/Wb²], coil."""

    gap_reluctance: float
    iron_reluctance: float
    per_knee_squared: float
    force: float
    residual_gap: float
    resistance: float
    per_turn: float
    eddy_lag: float


class State(NamedTuple):
    """Flux φ through one turn of the coil and pulling flux φ_f, delayed by the eddy currents [Wb]."""

    flux: float
    pulling_flux: float


TYPICAL = State(1e-4, 1e-4)  # sizes for a solver's absolute tolerances


class Circuit(NamedTuple):
    """Coil current [A], its slope di/dφ [A/Wb], and its decrease by the closing gap over half a step [A]."""

    current: float
    slope: float
    drift: float


@physics
def coefficients(p: Parameters) -> Coefficients:
    """Coefficients of the magnetic circuit, Eq. (11), (12)."""
    per_gap = 1.0 / (MU0 * p.pole_area)
    knee_flux = p.knee_flux_density * p.pole_area
    return Coefficients(
        gap_reluctance=p.air_gaps * per_gap,
        iron_reluctance=p.iron_length * per_gap / p.permeability,
        per_knee_squared=1.0 / (knee_flux * knee_flux),
        force=0.5 * p.air_gaps * per_gap,
        residual_gap=p.residual_gap,
        resistance=p.resistance,
        per_turn=1.0 / p.turns,
        eddy_lag=p.eddy_lag,
    )


@physics
def circuit(c: Coefficients, flux: float, armature_gap: float, closing: float = 0.0) -> Circuit:
    """Coil current and its slope, Eq. (11).

    Magnetisation curve H_s(B) = B/(μ0 μ_r) · (1 + (B/B_k)⁸): linear far below the knee B_k, then steep.

    `flux`: φ through one turn [Wb]; the current has its sign; `armature_gap`: part of the air gap that the armature
    leaves open [m], ≥ 0; `closing`: decrease of that gap in half a step [m].
    """
    air = c.gap_reluctance * (c.residual_gap + armature_gap)
    b2 = flux * flux * c.per_knee_squared
    b8 = b2 * b2 * b2 * b2
    current = flux * (air + c.iron_reluctance * (1.0 + b8)) * c.per_turn
    slope = (air + c.iron_reluctance * (1.0 + 9.0 * b8)) * c.per_turn
    return Circuit(current, slope, flux * c.gap_reluctance * closing * c.per_turn)


@physics
def magnetic_force(c: Coefficients, pulling_flux: float) -> float:
    """Magnetic force on the armature F_ev of Eq. (12) [N], never negative: it opens the valve.

    `pulling_flux`: φ_f [Wb], delayed by the eddy currents.
    """
    return c.force * pulling_flux * pulling_flux


# Decay of the flux that pulls the armature: eddy currents hold a falling flux for another time than a rising one.
#
# dφ_f/dt = (φ − φ_f)/τ, with τ the solenoid's `eddy_lag` while φ_f rises and the `lag` below while it falls. A
# saturated iron that is magnetised and one that is released differ in their permeability, hence in their eddy currents;
# the two constants are lumped ones. Not in the paper.


class DecayParameters(NamedTuple):
    """Lag of a falling flux."""

    lag: Annotated[
        float,
        Q("s", "lag of the pulling flux while it falls (0: none)", Domain.NON_NEGATIVE, 0.0, usual=(1e-6, 1e-3)),
    ]


@physics
def follow_flux(before: float, after: float, pulling: float, rising: float, falling: float) -> float:
    """Pulling flux φ_f [Wb] after a step: it follows the mean of φ over the step, or equals φ without a lag.

    `before`, `after`: φ at both ends of the step [Wb]; `pulling`: φ_f before the step [Wb]; `rising`, `falling`: share
    of the difference that a step makes up, 1 − exp(−dt/τ), for either direction [1].
    """
    ahead = 0.5 * (before + after) - pulling
    fraction = rising if ahead > 0.0 else falling
    return pulling + fraction * ahead if fraction < 1.0 else after


@physics
def lag_rate(flux: float, pulling: float, rising: float, falling: float) -> float:
    """dφ_f/dt [V], for a solver that has both fluxes at one time.

    `flux`, `pulling`: φ and φ_f [Wb]; `rising`, `falling`: lags τ of both directions [s], > 0.
    """
    ahead = flux - pulling
    return ahead / (rising if ahead > 0.0 else falling)
