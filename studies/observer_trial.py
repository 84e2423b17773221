"""Trial of the virtual sensor: truths of the reference engine that the observer's model cannot reproduce.

Each injector is cri2-16 with parameters drawn about those of the catalogue, also ones that the observer does not
estimate, with friction of the guides, which its model lacks, and with fuel 10 K colder or warmer than it assumes. The
explicit reference engine simulates its shots, trains included. Onto the rail's pressure come pump, three neighbours and
their waves (which the injector itself does not feel), then the sensor: gain, offset, delay, noise, 12 bits. Baselines:
the model without the pressure, and the drop of the rail's pressure, volume × Δp / K. `--air`: share of free air in the
fuel's volume at 0.1 MPa, which the observer does not know of.

    python -m studies.observer_trial truths FILE.npz --injectors 40 --shots 25 --seed 2
    python -m studies.observer_trial judge FILE.npz --injectors 40 [--with current,return]
    python -m studies.observer_trial currents --shots 200 --seed 2

`currents` judges energising times of 200 to 600 us that are read from peak-and-hold currents: of the model's PWM, and
of straight and bent edges with noise, at several rates of sampling.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import commonrail as cr
from commonrail.base.arrays import Floats
from commonrail.data.currents import read_energisings
from commonrail.engine.reference import Resolution, simulate_reference
from commonrail.engine.status import OK
from commonrail.physics.fuel import Fuel
from commonrail.plugins.observer.response import RATE_STEP, find_cuts, find_figures
from commonrail.plugins.observer.run import observe
from commonrail.plugins.observer.study import ObserverSettings

MODEL = "cri2-16"
RATE, CYCLE = 100e3, 40e-3  # samples a second; time from shot to shot at 3,000 revolutions a minute [s]
CYLINDER, RETURN = 5e6, 0.5e6
AFTER = 2.1e-3  # simulated beyond the last energising [s]
STILL = 0.2e-3  # simulated without an energising, for the guides' leak over the rest of a cycle [s]
FULL_SCALE = 220e6  # of the sensor [Pa]
# Of further sensors [E]: noise of the current, 1 % of its peak, and its full scale [A]; noise of a shot's return
# quantity; gains of both.
CURRENT_NOISE, CURRENT_SCALE, RETURN_NOISE, METER = 0.19, 40.0, 0.02, 0.01
MARGIN = 0.1e-3  # around an injection in which its rate is judged too [s]

# Relative standard deviations of the truths [E], in the size of the tolerances of cases/tolerance; the first are the
# observer's states too, the others it does not know.
SPREAD = {
    "nozzle.hole_diameter": 0.02,
    "valve.spring_preload": 0.03,
    "control_chamber.a_hole_diameter": 0.0075,
    "control_chamber.z_hole_diameter": 0.0075,
    "valve.lift": 0.02,
    "solenoid.residual_gap": 0.05,
    "plunger_needle.spring_preload": 0.04,
    "needle_seat.diameter": 0.005,
    "plunger_needle.plunger_diameter": 0.0005,
    "solenoid.eddy_lag": 0.10,
    "plunger_needle.guide_diameter": 0.0005,
    "plunger_needle.plunger_gap": 0.10,
    "plunger_needle.needle_gap": 0.10,
    "nozzle.discharge_maximum": 0.01,
    "nozzle.discharge_transition": 0.02,
    "nozzle.lift_transition_offset": 0.02,
    "nozzle.contraction": 0.01,
    "needle_seat.discharge": 0.02,
    "control_chamber.volume": 0.03,
    "control_chamber.a_hole_contraction": 0.01,
    "valve.mass": 0.02,
    "valve.spring_stiffness": 0.03,
    "valve.seat_diameter": 0.005,
    "solenoid.resistance": 0.03,
    "drive.boost_voltage": 0.02,
    "drive.peak_current": 0.02,
    "drive.hold_current": 0.02,
    "sac.volume": 0.03,
    "accumulation.volume": 0.03,
    "feed_pipe.length": 0.005,
    "feed_pipe.friction_factor": 0.10,
    "rail.volume": 0.005,
    "rail.throttle_diameter": 0.01,
}
FRICTION = (0.3, 0.3)  # of the guides on each of the nine masses: up to so many N and N s/m
GAIN, OFFSET, DELAY, NOISE = 0.005, 0.5e6, 5e-6, (0.05e6, 0.2e6)


ATMOSPHERE, POLYTROPIC = 0.1e6, 1.4  # [Pa]; exponent of air that exchanges no heat
SOFT = (
    20e6  # pressure from which downwards the volume of the air is a parabola: the engines' polynomials follow it [Pa]
)


@dataclass(frozen=True)
class AeratedFuel(Fuel):
    """Homogeneous mixture of a fuel with bubbles that feel its pressure at once and move with it (Wood 1930).

    Their volume follows p V^1.4 = const: 2 % at 0.1 MPa are 0.02 % at 60 MPa. They do not dissolve, and their
    mass is neglected. Below `SOFT` the mixture is less soft than it would be: with 2 % of air the modulus at 5 MPa is
    5 % lower than without, in place of 20 %.

    Attributes
    ----------
    air : float
        Share of the volume at 0.1 MPa.
    """

    air: float = 0.0

    @classmethod
    def of(cls, fuel: Fuel, air: float) -> AeratedFuel:
        """Mixture of a fuel with a share of air."""
        return cls(**{field.name: getattr(fuel, field.name) for field in fields(fuel)}, air=air)

    def bubbles(self, p: ArrayLike) -> tuple[Floats, Floats]:
        """Volume of the air per volume of the liquid at 0.1 MPa, and minus its slope by the pressure [1/Pa]."""
        softened, k = np.maximum(p, SOFT), 1.0 / POLYTROPIC
        volume = self.air / (1.0 - self.air) * (ATMOSPHERE / softened) ** k
        below = np.minimum(np.asarray(p) / SOFT - 1.0, 0.0)
        parabola = 1.0 - k * below + 0.5 * k * (k + 1.0) * below**2
        return volume * parabola, volume * k * (1.0 - (k + 1.0) * below) / softened

    def density(self, p: ArrayLike, temperature: ArrayLike) -> Floats:
        """Return the density of the mixture [kg/m3]."""
        return np.asarray(
            1.0 / (1.0 / super().density(p, temperature) + self._per_mass(temperature) * self.bubbles(p)[0])
        )

    def bulk_modulus(self, p: ArrayLike, temperature: ArrayLike) -> Floats:
        """Return the bulk modulus of the mixture [Pa]."""
        return self._softened(p, temperature, super().bulk_modulus(p, temperature))

    def isentropic_bulk_modulus(self, p: ArrayLike, temperature: ArrayLike) -> Floats:
        """Return the isentropic modulus of the mixture [Pa], of Wood's sound speed."""
        modulus = super().isentropic_bulk_modulus(p, temperature)  # `bulk_modulus` of a fuel without this law
        return modulus if self.isentropic_law is None else self._softened(p, temperature, modulus)

    def _per_mass(self, temperature: ArrayLike) -> Floats:
        return 1.0 / super().density(ATMOSPHERE, temperature)

    def _softened(self, p: ArrayLike, temperature: ArrayLike, modulus: Floats) -> Floats:
        liquid = 1.0 / (super().density(p, temperature) * self._per_mass(temperature))
        volume, slope = self.bubbles(p)
        return np.asarray((liquid + volume) / (liquid / modulus + slope))


def draw_part(rng: np.random.Generator, air: float = 0.0) -> tuple[cr.Injector, np.ndarray]:
    """Injector and friction (9, 2) of a truth; `air`: share of the fuel's volume at 0.1 MPa."""
    model = cr.load_injector(MODEL)
    if air:
        model = replace(model, fuel=AeratedFuel.of(model.fuel, air))
    values = {name: model.values[name] * (1.0 + s * rng.standard_normal()) for name, s in SPREAD.items()}
    values["fuel.temperature"] = model.values["fuel.temperature"] + 10.0 * rng.choice([-1.0, 1.0])
    return model.with_values(values), np.full((9, 2), FRICTION) * rng.uniform(0.0, 1.0, 2)


def schedule(rng: np.random.Generator) -> tuple[float, list[tuple[float, float]]]:
    """Rail pressure [Pa] and energisings [s] of a shot: four of ten have a pilot."""
    rail = rng.uniform(60e6, 160e6)
    main = rng.uniform(450e-6, 1000e-6)
    if rng.random() < 0.6:
        return rail, [(0.0, main)]
    pilot = 280e-6 + 120e-6 * (160e6 - rail) / 100e6 + rng.uniform(0.0, 60e-6)
    return rail, [(0.0, pilot), (pilot + rng.uniform(0.6e-3, 1.6e-3), main)]


def truths(path: Path, injectors: int, shots: int, seed: int, drift: float, air: float = 0.0) -> None:
    """Simulate and keep the truths; `drift`: relative change of the nozzle's flow from the middle shot on.

    `air`: share of the fuel's volume at 0.1 MPa.
    """
    rows: list[dict[str, Any]] = []
    begin = time.perf_counter()
    for k in range(injectors):
        rng = np.random.default_rng([seed, k])
        while True:
            injector, friction = draw_part(rng, air)
            worn = injector.with_values(
                {"nozzle.hole_diameter": injector.values["nozzle.hole_diameter"] * (1.0 + drift) ** 0.5}
            )
            states = [worn if i >= shots // 2 else injector for i in range(shots)]
            shot_records = [true_shot(state, friction, *schedule(rng)) for state in states]
            if all(shot_records):  # a part that does not work at some point would not pass the end of its line
                break
        rows.append({"values": injector.values["nozzle.hole_diameter"], "shots": shot_records})
        print(f"{k + 1}/{injectors} {time.perf_counter() - begin:.0f} s", flush=True)
    np.savez_compressed(path, rows=np.array(rows, object), seed=seed, drift=drift)


def true_shot(injector: cr.Injector, friction: np.ndarray, rail: float, pulses: list[Any]) -> dict[str, Any] | None:
    end = pulses[-1][0] + pulses[-1][1]
    point = cr.OperatingPoint(rail, pulses, CYLINDER, RETURN, horizon=end + AFTER)
    coarse = Resolution((90, 40), method="explicit", step=1e-7)
    solution = simulate_reference(injector, point, 2e-6, coarse, friction)
    if solution.status != OK:
        return None
    time, injected = np.asarray(solution.time), np.asarray(solution.injected)
    figures = find_figures(time, injected, find_cuts(time, injected, point.pulses))  # defined as the observer's
    figures[0] /= solution.reference_density
    still = simulate_reference(injector, cr.OperatingPoint(rail, 0.0, CYLINDER, RETURN, horizon=STILL), 2e-6, coarse)
    return {
        "rail": rail,
        "pulses": pulses,
        "pressure": np.asarray(solution.channels["rail_pressure"])[::5],
        "line": np.asarray(solution.channels["accumulation_pressure"])[::5],
        "injected": injected[::5] / solution.reference_density,  # every RATE_STEP
        "current": np.asarray(solution.channels["coil_current"]),  # every 2 us
        "returned": solution.returned_mass + still.returned_mass / STILL * (CYCLE - point.duration),  # in a cycle [kg]
        "figures": figures,
    }


def log_of(
    shots: list[dict[str, Any]],
    rng: np.random.Generator,
    sensor: str,
    others: str,
    errors: tuple[float, float, float, float] | None = None,
) -> tuple[Any, ...]:
    """Log of an injector: times [s], pressure [Pa], energisings; for `others` see `--others`.

    `errors`: delay [s], gain, offset [Pa] and noise [Pa] of the sensor, drawn unless given.
    """
    count = round((len(shots) * CYCLE + 5e-3) * RATE)
    clock, pressure, pulses = np.arange(count) / RATE, np.empty(count), []
    delay = rng.uniform(-DELAY, DELAY) if errors is None else errors[0]
    starts = 5e-3 + CYCLE * np.arange(len(shots)) + rng.uniform(0.0, 10e-6, len(shots))
    for start, shot in zip(starts, shots, strict=True):
        first = max(round((start - 12e-3) * RATE), 0)
        true = shot["pressure"] if sensor == "rail" else shot["line"]
        grid = start + delay + np.arange(len(true)) / RATE
        values = np.interp(clock[first:], grid, true, left=true[0])
        pressure[first:] = values
        pulses += [(float(start + a), b) for a, b in shot["pulses"]]
    if others != "none":
        pressure += _disturbance(clock, starts, rng, (0.02, 0.5, 0.75) if others == "at once" else (0.25, 0.5, 0.75))
    gain, offset, noise = (
        (GAIN * rng.standard_normal(), OFFSET * rng.standard_normal(), rng.uniform(*NOISE))
        if errors is None
        else errors[1:]
    )
    shown = pressure * (1.0 + gain) + offset + noise * rng.standard_normal(count)
    return clock, np.round(shown / (FULL_SCALE / 4096)) * (FULL_SCALE / 4096), pulses


def measure_further(
    shots: list[dict[str, Any]], log: tuple[Any, ...], rng: np.random.Generator, names: Sequence[str]
) -> dict[str, np.ndarray]:
    """Samples of further sensors in a log: current of the coil [A], and return flow, each cycle's mean [kg/s]."""
    clock, _, pulses = log
    channels = {name: np.zeros(len(clock)) for name in names}
    gains = METER * rng.standard_normal(2)
    firsts = np.cumsum([0, *(len(shot["pulses"]) for shot in shots)])[:-1]
    starts = [pulses[i][0] - shot["pulses"][0][0] for i, shot in zip(firsts, shots, strict=True)]
    for start, end, shot in zip(starts, [*starts[1:], starts[-1] + CYCLE], shots, strict=True):
        if "current" in channels:
            grid = start + 2e-6 * np.arange(len(shot["current"]))
            channels["current"] += (1.0 + gains[0]) * np.interp(clock, grid, shot["current"], left=0.0, right=0.0)
        if "return" in channels:
            returned = (1.0 + gains[1]) * shot["returned"] * (1.0 + RETURN_NOISE * rng.standard_normal())
            channels["return"][(clock >= start) & (clock < end)] = returned / (end - start)
    if "current" in channels:
        shown = channels["current"] + CURRENT_NOISE * rng.standard_normal(len(clock))
        channels["current"] = np.round(shown / (CURRENT_SCALE / 4096)) * (CURRENT_SCALE / 4096)
    return channels


def _disturbance(
    clock: np.ndarray, starts: np.ndarray, rng: np.random.Generator, parts: tuple[float, ...]
) -> np.ndarray:
    """Pump of three lobes a cycle, and three neighbours that lower the rail's pressure and leave waves in it [Pa].

    `parts`: shares of a cycle after which the neighbours inject.
    """
    drop = np.zeros_like(clock)
    frequency, decay = rng.uniform(1.2e3, 2.5e3), rng.uniform(0.5e-3, 2e-3)
    depth = rng.uniform(2e6, 5e6)
    for start in starts:
        for share in parts:
            since = clock - start - CYCLE * share - rng.uniform(-0.2e-3, 0.2e-3)
            after = np.maximum(since, 0.0)
            own_drop = depth * rng.uniform(0.9, 1.1)
            drop += own_drop * np.clip(since / 0.8e-3, 0.0, 1.0)
            drop -= 0.06 * own_drop * np.exp(-after / decay) * np.sin(2.0 * np.pi * frequency * after)
    turn = 2.0 * np.pi * (1.5 * clock / (CYCLE * rng.uniform(0.98, 1.02)) + rng.random())  # asynchronous to the engine
    delivered = np.cumsum(np.abs(np.sin(turn)))
    return np.asarray(delivered * drop[-1] / delivered[-1] - drop)


def judge(
    path: Path,
    out: Path | None,
    sensor: str,
    others: str,
    injectors: slice,
    *,
    horizon: int = 10,
    further: Sequence[str] = (),
) -> None:
    """Run the observer and the baselines over chosen injectors, and print their errors."""
    data = np.load(path, allow_pickle=True)
    model = cr.load_injector(MODEL)
    rows, alarms, begin = [], [], time.perf_counter()
    for k, truth in list(enumerate(data["rows"]))[injectors]:
        rng = np.random.default_rng([int(data["seed"]), k, 7])
        log = log_of(truth["shots"], rng, sensor, others)
        more = measure_further(truth["shots"], log, np.random.default_rng([int(data["seed"]), k, 8]), further)
        settings = ObserverSettings(horizon=horizon, sensor=sensor, cylinder_pressure=CYLINDER, return_pressure=RETURN)
        observation = observe(model, log[0], log[1], log[2], settings, further=more, threads=1)
        drops = _drops(model, log, truth["shots"])
        raised = [(i, shot.alarm.state) for i, shot in enumerate(observation.shots) if shot.alarm is not None]
        alarms.append((next((i for i, state in raised if state == "nozzle flow"), -1), [i for i, _ in raised]))
        print(k, raised, flush=True)
        for i, (shot, true) in enumerate(zip(observation.shots, truth["shots"], strict=True)):
            if shot.figures is None or shot.deviations is None or shot.open_loop is None:
                print(f"injector {k}, shot {i}: not simulated")
                continue
            for j in range(len(true["pulses"])):
                kind = "main" if j + 1 == len(true["pulses"]) else "pilot"
                rows.append(
                    {
                        "injector": k, "shot": i, "kind": kind, "train": len(true["pulses"]) > 1,
                        "true": true["figures"][:, j], "found": shot.figures[:, j], "sd": shot.deviations[:, j],
                        "open": shot.open_loop[:, j], "drop": drops[i] if len(true["pulses"]) == 1 else (np.nan,) * 2,
                        "consistency": shot.consistency,
                        "fit": [_fit(true, j, rate) for rate in (shot.rate, shot.rate_open_loop)],
                    }
                )  # fmt: skip
    _print(rows, alarms, int(data["drift"] != 0.0) * len(data["rows"][0]["shots"]) // 2)
    print(f"{len(alarms)} injectors, {time.perf_counter() - begin:.0f} s")
    if out is not None:
        out.write_text(json.dumps([{key: np.asarray(v).tolist() for key, v in row.items()} for row in rows]))


def _fit(true: dict[str, Any], j: int, rate: np.ndarray | None) -> float:
    """R² of a rate of injection from 0.1 ms before the true opening to 0.1 ms after the true closing; NaN without."""
    if rate is None or "injected" not in true:
        return np.nan
    ends = (true["figures"][1:, j] + [-MARGIN, MARGIN]) / RATE_STEP
    if not np.isfinite(ends).all():
        return np.nan
    within = slice(max(int(ends[0]), 0), int(ends[1]))
    actual, shown = np.diff(true["injected"])[within] / RATE_STEP, rate[within]
    actual = actual[: len(shown)]
    return float(1.0 - np.sum((actual - shown) ** 2) / np.sum((actual - actual.mean()) ** 2))


def _drops(model: cr.Injector, log: tuple[Any, ...], shots: list[dict[str, Any]]) -> list[tuple[float, float]]:
    """Quantity of each shot from the drop of the pressure, its trend before the shot continued [m³].

    First V Δp/K, then the same times the share that is injected of what the model's rail loses at that point.
    """
    clock, pressure, pulses = log
    drops, volume, at = [], model.values["rail.volume"], 0
    warmth = model.values["fuel.temperature"]
    for shot in shots:
        start, end = pulses[at][0], pulses[at + len(shot["pulses"]) - 1][0] + pulses[at][1]
        at += len(shot["pulses"])
        before = (clock > start - 1e-3) & (clock < start)
        after = (clock > end + 1.3e-3) & (clock < end + 2e-3)
        trend = np.polyfit(clock[before] - start, pressure[before], 1)
        drop = float(np.mean(np.polyval(trend, clock[after] - start) - pressure[after]))
        mean = float(pressure[before].mean()) - 0.5 * drop
        fuel = model.fuel
        ratio = float(fuel.density(mean, warmth)) / float(fuel.density(CYLINDER, warmth))
        step = 1e5
        modulus = mean and float(fuel.density(mean, warmth)) * 2 * step / float(
            fuel.density(mean + step, warmth) - fuel.density(mean - step, warmth)
        )
        raw = volume * drop / modulus * ratio
        point = cr.OperatingPoint(shot["rail"], shot["pulses"], CYLINDER, RETURN, horizon=end - start + 2e-3)
        simulated = cr.simulate(model, point)
        taken = float(simulated.channels["rail_pressure"][0] - simulated.channels["rail_pressure"][-400:].mean())
        drops.append((raw, simulated.injected_volume * drop / taken if taken > 0.0 else np.nan))
    return drops


def currents(shots: int, seed: int) -> None:
    """Print how many readings of currents are refused, and the largest error of the others, by drive and rate."""
    rng = np.random.default_rng(seed)
    durations, gaps = rng.uniform(200e-6, 600e-6, shots), rng.uniform(0.0, 100e-6, shots)
    starts = 5e-3 + 8e-3 * np.arange(shots) + gaps
    model = cr.load_injector("cri2-16@pwm")
    points = [cr.OperatingPoint(rng.uniform(40e6, 160e6), float(item), horizon=2e-3) for item in durations]
    solved = [cr.simulate(model, point) for point in points]
    drives = {"model's PWM": [(solution.time, solution.channels["coil_current"]) for solution in solved]}
    for fall in (15e-6, 30e-6, 60e-6):
        for bent in (False, True):
            name = f"18 A, 12 A, {'bent' if bent else 'straight'} fall of {fall * 1e6:.0f} us"
            drives[name] = [(FINE, _peak_and_hold(FINE, item, fall, bent)) for item in durations]
    for name, courses in drives.items():
        for rate in (10e3, 20e3, 50e3, 100e3, 200e3, 1e6):
            clock = np.arange(0.0, starts[-1] + 8e-3, 1.0 / rate)
            value = 0.4 + 0.15 * rng.standard_normal(len(clock))
            for start, (at, amperes) in zip(starts, courses, strict=True):
                window = slice(*np.searchsorted(clock, [start, start + at[-1]]))
                value[window] += np.interp(clock[window] - start, at, amperes)
            read = read_energisings(clock, value)
            if len(read) != shots:
                print(f"{name:32s} {rate / 1e3:5.0f} kHz: {len(read)} energisings of {shots}")
                continue
            deviations = np.array([item.duration for item in read]) - durations
            sure = np.isfinite([item.error for item in read])
            largest = f"largest error {1e6 * np.abs(deviations[sure]).max():4.1f} us" if sure.any() else ""
            print(f"{name:32s} {rate / 1e3:5.0f} kHz: {(~sure).sum():3d} of {shots} refused  {largest}")


FINE = np.arange(0.0, 2e-3, 0.5e-6)  # times of such a current [s]


def _peak_and_hold(time: Floats, duration: float, fall: float, bent: bool) -> Floats:
    """Current [A] that rises in 90 us to 18 A, falls from 150 us on to 12 A, and to zero after the command."""
    rise = 18.0 * (1.0 - np.exp(-time / 60e-6)) / (1.0 - np.exp(-1.5)) if bent else 0.2e6 * time
    flowing = np.minimum(np.minimum(rise, 18.0), np.maximum(18.0 - 0.12e6 * (time - 150e-6), 12.0))
    level, since = float(np.interp(duration, time, flowing)), np.maximum(time - duration, 0.0)
    ended = 2.0 * np.exp(-since / fall * np.log(2.0)) - 1.0 if bent else 1.0 - since / fall
    return np.asarray(np.where(time < duration, flowing, level * np.maximum(ended, 0.0)))


BASELINES = (
    ("observer", "found", 0),
    ("model alone", "open", 0),
    ("V dp/K", "drop", 0),
    ("drop, model's share", "drop", 1),
)


def _print(rows: list[dict[str, Any]], alarms: list[Any], onset: int) -> None:
    for kind in ("main", "pilot"):
        selected = [row for row in rows if row["kind"] == kind]
        if not selected:
            continue
        keys = ("true", "found", "sd", "open", "drop")
        table = {key: np.array([row[key] for row in selected], float) for key in keys}
        true = table["true"][:, 0]
        low, high = np.quantile(true, (0.05, 0.95)) * 1e9
        print(f"{kind}: {len(true)} injections, {low:.1f} to {high:.1f} mm3")
        for name, key, j in BASELINES:
            error = np.abs(table[key][:, j] - true)
            good = np.isfinite(error)
            if good.any():
                middle, end = np.quantile(100.0 * error[good] / true[good], (0.5, 0.95))
                least, most = np.quantile(error[good] * 1e9, (0.5, 0.95))
                print(
                    f"  {name:20s} median {middle:6.2f} %, 95 % {end:6.2f} %; median {least:6.3f} mm3, 95 % "
                    f"{most:6.3f} mm3 ({good.sum()})"
                )
        for j, name in enumerate(("quantity", "opening", "closing")):
            ratio = (table["found"][:, j] - table["true"][:, j]) / table["sd"][:, j]
            share_inside, size = np.mean(np.abs(ratio) < 1.96), np.sqrt(np.mean(ratio**2))
            inside = f"the stated 95 % hold {100.0 * share_inside:.1f} %"
            print(f"  {name}: {inside}, rms of error over deviation {size:.2f}")
            for label, key in (("observer", "found"), ("model alone", "open")):
                if j:
                    error = np.abs(table[key][:, j] - table["true"][:, j]) * 1e6
                    middle, end = np.nanquantile(error, (0.5, 0.95))
                    print(f"    {label:12s} median {middle:6.2f} us, 95 % {end:6.2f} us")
        for i, label in enumerate(("observer", "model alone")):
            fit = np.array([row["fit"][i] for row in selected], float)
            if np.isfinite(fit).any():
                low, middle = np.nanquantile(fit, (0.05, 0.5))
                good = 100.0 * np.mean(fit[np.isfinite(fit)] >= 0.98)
                print(f"  R2 of the rate, {label}: median {middle:.4f}, 5 % below {low:.4f}, {good:.0f} % reach 0.98")
    print(f"consistency, median: {np.median([row['consistency'] for row in rows]):.2f}")
    if onset:
        late = [first - onset + 1 if first >= onset else None for first, _ in alarms]
        print("shots from the drift to the alarm of the nozzle's flow:", late)
    shots = len({(row["injector"], row["shot"]) for row in rows if not onset or row["shot"] < onset})
    false = sum(i < onset or not onset for _, at in alarms for i in at)
    print(f"shots with an alarm before any drift: {false} of {shots}")


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("truths", "judge", "currents"))
    parser.add_argument("file", type=Path, nargs="?")
    parser.add_argument("--injectors", type=int, default=30)
    parser.add_argument("--first", type=int, default=0, help="judge: injectors that are left out at the beginning")
    parser.add_argument("--shots", type=int, default=20)
    parser.add_argument("--seed", type=int, default=2)
    parser.add_argument("--drift", type=float, default=0.0)
    parser.add_argument("--air", type=float, default=0.0, help="truths: share of the fuel's volume at 0.1 MPa")
    parser.add_argument("--sensor", choices=("rail", "line"), default="rail")
    parser.add_argument("--others", choices=("apart", "at once", "none"), default="apart", help="neighbours and pump")
    parser.add_argument("--horizon", type=int, default=10, help="judge: as in `observe`")
    parser.add_argument("--with", dest="further", default="", help="judge: further sensors, of current,return")
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    if args.what == "currents":
        currents(args.shots, args.seed)
    elif args.file is None:
        parser.error("name the FILE.npz")
    elif args.what == "truths":
        truths(args.file, args.injectors, args.shots, args.seed, args.drift, args.air)
    else:
        injectors = slice(args.first, args.first + args.injectors)
        further = [name for name in args.further.split(",") if name]
        judge(args.file, args.out, args.sensor, args.others, injectors, horizon=args.horizon, further=further)


if __name__ == "__main__":
    main()
