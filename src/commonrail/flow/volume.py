"""A lumped volume, Eq. (3), kept in mass.

The state is the mass m; density is m/V and pressure follows from it, so dm/dt = Σ q conserves mass to
rounding and (K_f/V)(−dV/dt + Σ Q) of Eq. (3) is its consequence. Over one step the flows are taken
linear in the pressure, q(p) = q_n + Σ s (p − p_n) with Σ s = −S, and the geometry that of mid-step. The
pressure then relaxes as exp(−y), y = dt · S · (dp/dρ)/V; its mean departure from p_n over the step is

    δ = dt · dp/dt · φ2(y),   φ2(y) = (1/2 + y/6)/(1 + 2y/3 + y²/6)

a rational form of (1 − (1 − e^(−y))/y)/y: second order for y → 0, exact equilibrium for y → ∞ (L-stable).
Every flow's mean over the step is q_n ± s δ, and the mass changes by exactly their sum.
"""

from __future__ import annotations

from commonrail.compile import physics


@physics
def relaxation(y: float) -> float:
    """φ1(y) = (1 + y/6)/(1 + 2y/3 + y²/6) ≈ (1 − e^(−y))/y: change over a step, divided by dt times its first rate [1].

    Parameters
    ----------
    y : float
        Step over relaxation time [1], ≥ 0.
    """
    return (1.0 + y * (1.0 / 6.0)) / (1.0 + y * (2.0 / 3.0 + y * (1.0 / 6.0)))


@physics
def mean_departure(net_flow: float, slope: float, stiffness: float, volume: float, growth: float, dt: float) -> float:
    """Mean over the step of p − p_n [Pa].

    Parameters
    ----------
    net_flow : float
        Σ q at the start of the step [kg/s], positive into the volume.
    slope : float
        S = −∂(Σ q)/∂p ≥ 0 [kg/(s Pa)].
    stiffness : float
        dp/dρ = K/ρ [Pa m³/kg].
    volume : float
        V in mid-step [m³], > 0.
    growth : float
        ρ dV/dt [kg/s], subtracted from the net flow.
    dt : float
        Step [s].
    """
    spring = dt * stiffness  # V² times numerator and denominator of φ2: one division
    yv = spring * slope  # y V
    numerator = spring * (net_flow - growth) * (0.5 * volume + yv * (1.0 / 6.0))
    return numerator / (volume * volume + yv * (volume * (2.0 / 3.0) + yv * (1.0 / 6.0)))
