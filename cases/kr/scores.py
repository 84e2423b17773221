"""NRMSE and mass error of the calibrated injector on every trace of the case, with a trivial model beside it.

Usage: python cases/kr/scores.py RUN, where RUN is a folder of `commonrail calibrate cases/kr/study.toml`; without RUN
the injector that ships with the case is judged. NRMSE is the rms error of a trace over its largest measured rate. The
trivial model predicts a trace by that of 20 MPa with the same energising time, scaled by the ratio of the largest rates
at 2000 us. The last table shows what the mass of a trace can be predicted to: while two energisings at one pressure are
alike, so are the injections, and their measured masses differ by what the measurement scatters.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import commonrail as cr
from commonrail.data.simulator import Simulator

Floats = NDArray[np.float64]
Place = tuple[int, int]
LONG = 2000  # energising time [us] that is measured at each pressure
APART = 0.01  # difference of two simulated rates, as a share of the largest measured one, that ends what is alike
HERE = Path(__file__).parent


def judged(rate: Floats, data: cr.RateData) -> tuple[float, float]:
    """NRMSE and error of the injected mass of a rate, both in percent."""
    rms = float(np.sqrt(np.mean((rate - data.rate) ** 2)) / data.rate.max())
    mass = float(np.sum(rate * np.diff(data.bounds)) / np.sum(data.rate * np.diff(data.bounds))) - 1.0
    return 100.0 * rms, 100.0 * mass


def place(data: cr.RateData) -> tuple[int, int]:
    """Rail pressure [MPa] and energising time [us] of a trace."""
    point = data.point
    return round(point.at_start(point.rail_pressure) * 1e-6), round(point.pulses[0].duration * 1e6)


def at_times_of(data: cr.RateData, other: cr.RateData, rate: Floats) -> Floats:
    """Rate of another trace, at the samples of this one."""
    middles = [0.5 * (one.bounds[1:] + one.bounds[:-1]) for one in (data, other)]
    return np.asarray(np.interp(middles[0], middles[1], rate))


def trivial(data: cr.RateData, known: dict[Place, cr.RateData]) -> Floats | None:
    """Trace of 20 MPa with the same energising time, scaled; None at 20 MPa itself."""
    pressure, time = place(data)
    other = known[20, time]
    if pressure == 20:
        return None
    ratio = known[pressure, LONG].rate.max() / known[20, LONG].rate.max()
    return np.asarray(ratio * at_times_of(data, other, other.rate))


def alike(where: Place, known: dict[Place, cr.RateData], simulated: dict[Place, Floats]) -> tuple[float, float, float]:
    """Time up to which a trace and that of 2000 us are of one injection [us], and how far their masses differ [%].

    Parameters
    ----------
    where : (int, int)
        Of the trace.
    known : mapping of places to RateData
    simulated : mapping of places to rates
        Of the model, each with its trace's own measured current: what ends the likeness, and what the currents explain.

    Returns
    -------
    tuple of float
        Time, difference of the measured masses, difference of the simulated ones.
    """
    own, other = known[where], known[where[0], LONG]
    beside = at_times_of(own, other, simulated[where[0], LONG])
    ended = (abs(simulated[where] - beside) > APART * own.rate.max()) & (own.bounds[1:] > 1e-6 * where[1])
    until = int(np.argmax(ended)) if ended.any() else len(own.rate)
    pairs = (own.rate, at_times_of(own, other, other.rate)), (simulated[where], beside)
    masses = [[float(np.sum((rate * np.diff(own.bounds))[:until])) for rate in pair] for pair in pairs]
    measured, explained = (100.0 * (mine / others - 1.0) for mine, others in masses)
    return 1e6 * float(own.bounds[until]), measured, explained


def main(run: str | None) -> None:
    """Print the table.

    Parameters
    ----------
    run : str or None
        Run folder.
    """
    study = cr.load_study(HERE / "study.toml")
    calibrated = (HERE if run is None else Path(run)) / "calibrated.toml"
    injector, meters = cr.load_injector(calibrated), cr.models.load_meters(calibrated)
    simulator = Simulator(injector, (), study.time_step)
    curves = [d.changed(meter=meters[0]) for d in study.data if isinstance(d, cr.RateData)]
    known, table = {place(d): d for d in curves}, []
    simulated = {place(d): d.score(simulator).values for d in curves}
    print("trace               role         NRMSE    mass     trivial model")
    for d in sorted(curves, key=place):
        found, plain = judged(simulated[place(d)], d), trivial(d, known)
        table.append((d.role, place(d)[1], *found))
        beside = "" if plain is None else "{:6.2f} % {:+6.2f} %".format(*judged(plain, d))
        print(f"{d.name:19s} {d.role.value:10s} {found[0]:6.2f} % {found[1]:+6.2f} %   {beside}")
    for role in (cr.data.Role.FIT, cr.data.Role.VALIDATION):
        nrmse = np.array([row[2] for row in table if row[0] is role])
        print(f"{role.value}: median NRMSE {np.median(nrmse):.2f} %, largest {nrmse.max():.2f} %")
    mass = np.array([abs(row[3]) for row in table if row[1] >= 500])
    print(f"mass, 500 us and longer: median {np.median(mass):.2f} %, largest {mass.max():.2f} %")
    print(f"mass up to where it is of one injection with the trace of {LONG} us, relative to that trace's")
    for where in sorted(known):
        if where[1] in (500, 700, 1000):
            until, measured, explained = alike(where, known, simulated)
            print(f"{known[where].name:19s} until {until:5.0f} us: {measured:+5.2f} %, simulated {explained:+5.2f} %")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
