"""Equations of the direct-acting injector as a whole, dy/dt = f(t, y); laws and pipe are those of `rates`.

    dm/dt (accumulation) = q_pipe − q_seat                                  (3), in mass
    dm/dt (SAC)          = q_seat − q_nozzle                                (3), in mass
    q_seat, q_nozzle: orifices (4), c_d of the nozzle (9); feed pipe        (6)
    N dφ/dt = v − R i of the solenoid                                       (11), (12)

and Newton's second law of armature and needle, which is not in the paper.
"""

from __future__ import annotations

from collections.abc import Callable

from commonrail.engine.instant import OUTSIDE, coil_law, coil_rates
from commonrail.engine.rates import make_hydraulics, pipe_rates
from commonrail.engine.vector import DirectCore, NeedleMasses, core_of, make_frame
from commonrail.injector import joints
from commonrail.injector.direct_setup import moving_masses
from commonrail.injector.direct_step import needle_pressure
from commonrail.injector.model import CumulativeFlows
from commonrail.injector.setup import seat_contact
from commonrail.injector.variants import Variant, wiring
from commonrail.parts import direct_needle, nozzle, solenoid

INSTANT = 1e-9  # in place of a lag of zero [s]: the flux then follows within a thousandth of a step


def make_direct_rates(variant: Variant) -> Callable[..., None]:
    """Function (y, outside, constants, cells, friction, dy) of a variant; its guides have no friction."""
    wired, frame, hydraulics = wiring(variant), make_frame(variant), make_hydraulics(variant)
    load, load_outside = wired.coefficients.load, OUTSIDE.load
    load_core, store_core = core_of(variant).load, core_of(variant).store
    load_masses, store_masses = wired.positions.load, wired.positions.store
    accelerations, discharge, coil = wired.accelerations, wired.laws.discharge, coil_law(variant)

    def rates(y, outside_, constants, cells, friction, dy):  # type: ignore[no-untyped-def]
        c, outside, at = load(constants, 0, 1), load_outside(outside_, 0, 1), frame(cells)
        s = load_core(y, at.core, 1)
        z, v = load_masses(y, at.body, 2), load_masses(y, at.body + 1, 2)
        h = hydraulics(c, s.fuel, s.nozzle.lift_reached, z)

        # flows: orifices, Eq. (4), with c_d of the nozzle by Eq. (9)
        pipe = y[at.core - 1]
        seat = joints.seat_flow(c, h.accumulation, h.sac, z.needle).mass_flow
        spray = joints.nozzle_flow(c, h.sac, outside.cylinder, discharge(c.nozzle, h.reached)).mass_flow

        # solenoid, Eq. (11), (12), with a lag for either direction
        lags = max(c.solenoid.eddy_lag, INSTANT), max(c.flux_decay.lag, INSTANT)
        magnet = coil_rates(c, outside, coil, s.solenoid, c.armature.travel - z.armature, lags)

        # lift that c_d of Eq. (9) remembers
        excess = h.sac.pressure - outside.cylinder
        remembering = joints.memory_rate(c, s.nozzle.lift_reached, z.needle, v.needle, excess)

        slopes = DirectCore(
            solenoid=magnet,
            fuel=NeedleMasses(accumulation=pipe - seat, sac=seat - spray),  # balances, Eq. (3)
            nozzle=nozzle.State(remembering, spray),
            cumulative_flows=CumulativeFlows(returned=0.0, supplied=y[0]),
        )
        store_core(dy, at.core, 1, slopes)

        # armature and needle
        magnetic_force = solenoid.magnetic_force(c.solenoid, s.solenoid.pulling_flux)
        load_ = direct_needle.Loads(magnetic_force, needle_pressure(c, h.accumulation.pressure, h.sac.pressure))
        store_masses(dy, at.body, 2, v)
        store_masses(dy, at.body + 1, 2, accelerations(moving_masses(c), seat_contact(c), z, v, load_))

        # feed pipe, Eq. (6)
        pipe_rates(y, dy, cells[0], c, outside.rail, h.accumulation.pressure)

    return rates
