"""Benches of injectors that no model of commonrail made, as files: maps, rate curves, and quantities to be predicted.

The models are NumPy alone and share no law with `commonrail.physics`. `trapezoid` has ramps of constant speed and a
nozzle that saturates with the lift; its meter comes late by 0.31 ms. `delayed` is a needle that follows its valve as
an oscillator of second order, after an orifice whose discharge coefficient depends on cavitation and a feed pipe whose
waves lower the pressure after the opening. `wiebe` is an empirical rate: Wiebe ramps, a closing delay that grows with
the energising time, and a wave of the return pipe on the quantity. All of their data are SYNTHETIC.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfilt

__all__ = ["FOREIGN", "ForeignBench", "write_bench"]

Floats = NDArray[np.float64]

DENSITY, CYLINDER = 812.0, 5e6  # of the fuel at 40 °C [kg/m³]; pressure in the cylinder [Pa]
STEP, BEGIN, END = 1e-6, -0.5e-3, 4e-3  # of the models and of the curves [s]
TIME = np.arange(BEGIN, END, STEP)
MAP_RAIL = (250, 400, 600, 800, 1000, 1200, 1400, 1600)  # [bar]
MAP_TIME = (180, 220, 260, 300, 350, 400, 500, 600, 800, 1000, 1200)  # [us]
UNSEEN_RAIL, UNSEEN_TIME = (500, 900, 1300, 1500), (240, 320, 450, 700, 900)  # [bar], [us]
MAP_NOISE, MAP_FLOOR, LEAST = 0.012, 0.08, 0.15  # relative; [mm³]; shown as zero below [mm³]
UNSEEN_NOISE, RATE_NOISE = 0.01, 0.3  # relative; [mm³/ms]

Rate = Callable[[float, float], Floats]  # of rail pressure [Pa] and energising time [s], over TIME [m³/s]


@dataclass(frozen=True)
class ForeignBench:
    """A foreign injector and the meter that sees it.

    Attributes
    ----------
    rate : function of float and float
        Rates [m³/s] at `TIME` by rail pressure [Pa] and energising time [s].
    curves : tuple of (int, int)
        Rail pressures [bar] and energising times [us] of the measured curves.
    delay, cutoff : float
        Of the meter [s], [Hz].
    holes, hole, lift : float
        What a drawing says: holes of the nozzle, their diameter [mm] and the needle's lift [mm].
    """

    rate: Rate
    curves: tuple[tuple[int, int], ...]
    delay: float
    cutoff: float
    holes: int
    hole: float
    lift: float


def _area(holes: int, hole: float) -> float:
    return holes * np.pi / 4.0 * (1e-3 * hole) ** 2


def _trapezoid_rate(rail: float, energising: float) -> Floats:
    """Lift with ramps of constant speed, rate by its hyperbolic tangent."""
    kilobar = rail / 1e8
    begin, end = 270e-6 + 220e-6 / (10.0 * kilobar), energising + 150e-6 + 12e-6 * kilobar
    lift = np.clip((0.28 + 0.11 * kilobar) * (TIME - begin), 0.0, 0.22e-3)
    top = float(np.interp(end, TIME, lift))
    lift = np.where(end < TIME, np.maximum(top - (0.40 + 0.17 * kilobar) * (TIME - end), 0.0), lift)
    full = 0.82 * _area(7, 0.128) * np.sqrt(2.0 * (rail - CYLINDER) / DENSITY)
    return np.asarray(full * np.tanh(lift / 0.055e-3) ** 1.3)


def _delayed_rate(rail: float, energising: float) -> Floats:
    """Needle of second order, orifice with cavitation, pipe waves."""
    holes, seat, lift_end = _area(8, 0.12), np.pi * 2.0e-3 * 0.5, 0.24e-3
    opening, closing = 260e-6 + 25e-6 * 100e6 / rail, 140e-6 + 40e-6 * rail / 100e6
    frequency, damping = 2.0 * np.pi * (280.0 + 140.0 * rail / 100e6), 0.8
    impedance, echo, reflection = 2.5e11, 320e-6, 0.7  # of the pipe [Pa s/m³]; its travel time to and fro [s]
    lag = round(echo / STEP)
    lift = speed = 0.0
    rate, waves = np.zeros(len(TIME)), np.zeros(len(TIME))  # waves: outflow and its echoes from the rail's open end
    for i, time in enumerate(TIME):
        target = 1.6 * lift_end if opening < time < energising + closing else -1.5 * lift_end
        speed += STEP * (frequency**2 * (target - lift) - 2.0 * damping * frequency * speed)
        lift += STEP * speed
        if not 0.0 < lift < lift_end:
            lift, speed = min(max(lift, 0.0), lift_end), 0.0
        pressure = max(rail - impedance * waves[i - 1], CYLINDER)
        cavitation = np.sqrt(
            pressure / max(pressure - CYLINDER, 1e5)
        )  # Nurick: c_d = c_c √K, up to its turbulent value
        coefficient = min(0.70 * cavitation * (1.0 + 0.06 * CYLINDER / 5e6), 0.84)
        through = 1.0 / np.sqrt(1.0 / (0.75 * seat * lift + 1e-12) ** 2 + 1.0 / (coefficient * holes) ** 2)
        rate[i] = through * np.sqrt(2.0 * (pressure - CYLINDER) / DENSITY) if lift > 0.0 else 0.0
        waves[i] = rate[i] - (reflection * (rate[i - lag] + waves[i - lag]) if i >= lag else 0.0)
    return rate


def _wiebe_rate(rail: float, energising: float) -> Floats:
    """Wiebe ramps; ballistic where the closing begins before the ramp has ended."""
    unit = rail / 100e6
    full = 0.80 * _area(7, 0.125) * np.sqrt(2.0 * (rail - CYLINDER) / DENSITY) * (1.0 - 0.012 * unit)
    opening = 130e-6 + 95e-6 / np.sqrt(unit)
    closing = 60e-6 + 190e-6 * (1.0 - np.exp(-energising / 350e-6)) + 25e-6 * unit
    closing += 14e-6 * np.exp(-energising / 600e-6) * np.sin(2.0 * np.pi * energising / 260e-6)  # wave of the return
    rise, fall = (420e-6 - 70e-6 * unit) * 0.9, 230e-6 + 30e-6 * unit
    end = energising + closing

    def wiebe(since: Floats | float, lasting: float, form: float) -> Floats:
        return np.asarray(1.0 - np.exp(-6.9 * (np.maximum(since, 0.0) / lasting) ** (form + 1.0)))

    up = wiebe(TIME - opening, rise, 0.9)
    top = float(wiebe(end - opening, rise, 0.9))
    down = top * (1.0 - wiebe(TIME - end, fall * max(top, 0.2), 1.2))
    return np.asarray(full * np.where(end < TIME, down, up) if end > opening else np.zeros(len(TIME)))


_THREE = ((500, 500), (1000, 700), (1600, 900))
FOREIGN = {
    "trapezoid": ForeignBench(_trapezoid_rate, _THREE, 310e-6, 9e3, 7, 0.128, 0.22),
    "delayed": ForeignBench(_delayed_rate, _THREE, 35e-6, 12e3, 8, 0.12, 0.24),
    "wiebe": ForeignBench(_wiebe_rate, ((600, 400), (1200, 800)), 150e-6, 9e3, 7, 0.125, 0.22),
}


def quantity(bench: ForeignBench, rail: int, energising: int) -> float:
    """Quantity [mm³] at a rail pressure [bar] and an energising time [us]."""
    return float(bench.rate(1e5 * rail, 1e-6 * energising).sum() * STEP * 1e9)


def write_bench(bench: ForeignBench, folder: Path, seed: int) -> tuple[list[Path], dict[tuple[int, int], float]]:
    """Write map, curves and injector of a bench into a new folder.

    Returns
    -------
    files : list of Path
        For `commonrail new --from`; injector.toml is in the same folder.
    unseen : dict
        Quantities [mm³] with noise, by rail pressure [bar] and energising time [us], that no file has.
    """
    folder.mkdir(parents=True)
    rng = np.random.default_rng(seed)
    lines = ["rail pressure [bar] \\ energising time [us];" + ";".join(map(str, MAP_TIME))]
    for rail in MAP_RAIL:
        row = []
        for energising in MAP_TIME:
            value = quantity(bench, rail, energising) * (1.0 + MAP_NOISE * rng.standard_normal())
            value += MAP_FLOOR * rng.standard_normal()
            row.append(f"{value if value > LEAST else 0.0:.2f}")
        lines.append(";".join([str(rail), *row]))
    files = [folder / "map.csv"]
    files[0].write_text("injected quantity [mm3]\n" + "\n".join(lines) + "\n", encoding="utf-8")
    for rail, energising in bench.curves:
        rate = sosfilt(butter(2, bench.cutoff, fs=1.0 / STEP, output="sos"), bench.rate(1e5 * rail, 1e-6 * energising))
        late = round(bench.delay / STEP)
        rate = 1e6 * np.concatenate([np.zeros(late), rate[:-late]])[::5]
        rate = rate + RATE_NOISE * rng.standard_normal(len(rate))
        rows = [f"{1e3 * t:.3f},{r:.3f}" for t, r in zip(TIME[::5], rate, strict=True)]
        files.append(folder / f"rate_{rail}bar_{energising}us.csv")
        files[-1].write_text("time [ms],rate [mm3/ms]\n" + "\n".join(rows) + "\n", encoding="utf-8")
    (folder / "injector.toml").write_text(_injector(bench), encoding="utf-8")
    points = [(rail, energising) for rail in UNSEEN_RAIL for energising in UNSEEN_TIME]
    unseen = {at: quantity(bench, *at) * (1.0 + UNSEEN_NOISE * rng.standard_normal()) for at in points}
    return files, unseen


def _injector(bench: ForeignBench) -> str:
    """Injector as its drawing states it, all else of the catalogue's type."""
    return f"""\
format = "commonrail-injector/1"
name = "foreign"
title = "{bench.holes} holes of {bench.hole} mm"
base = "cri2-16"

[nozzle]
mark = "M"
source = "drawing"
holes = {bench.holes}
hole_diameter = "{bench.hole} mm"

[plunger_needle]
mark = "M"
source = "drawing"
stop_lift = "{bench.lift} mm"

[fuel]
name = "iso4113"
temperature = "40 degC"
"""
