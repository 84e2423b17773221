"""Studies of virtual benches that are right, or wrong in one law or constant which they do not free.

A bench is a hidden truth, the catalogue's injector with three values moved, simulated at a quarter of the study's time
step: one or two rate curves, and of two benches in three a map of twelve quantities. The study frees the three values.
In a wrong one the truth has a further change, `WRONGS`, which the study does not know. Noise is white, autoregressive,
white with outliers, or white with a delay of the meter that the study states as uncertain. All data are SYNTHETIC, and
are not marked so: the mark has a say in the verdict.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import commonrail as cr
from commonrail.base.choices import Drive
from commonrail.data.noise import Noise
from studies.noises import NOISES

__all__ = ["UNSEEN", "Bench", "draw_bench"]

Floats = NDArray[np.float64]

STEP = 1e-6  # of a study; truths have a quarter of it [s]
SPREAD, OFF = 0.2, 0.04  # bounds, and distance of the truth from the catalogue's value; relative
SIGMA, INTERVAL = 0.3e-6, 5e-6  # of a curve: noise [m³/s] and samples [s]
ABSOLUTE, RELATIVE = 0.05e-9, 0.01  # of a map: tolerance, which is its noise [m³]
RIGHT = 0.4  # share of the studies
CYLINDER, RETURN = 5e6, 1e5  # [Pa]

INJECTORS = ("cri2-16", "virtual-lino-2016")
FREE = (
    ("nozzle.hole_diameter", "control_chamber.z_hole_diameter", "valve.spring_preload"),
    ("nozzle.discharge_maximum", "control_chamber.a_hole_diameter", "plunger_needle.k7"),
)
CURVES = ((120e6, 600e-6), (80e6, 900e-6))  # rail pressure [Pa] and energising time [s]
MAP = tuple((1e6 * rail, 1e-6 * time) for rail in (50, 90, 130, 160) for time in (350, 550, 850))
UNSEEN = tuple((1e6 * rail, 1e-6 * time) for rail in (70, 110, 150) for time in (450, 700))
HELD_BACK = ((100e6, 400e-6), (100e6, 750e-6), (140e6, 400e-6), (140e6, 750e-6))  # measured, not fitted
NOISES_USED = ("white", "autoregressive", "outliers", "delay")


class Wrong(NamedTuple):
    """Change of the truth that a study does not know: factors and sums on the injector's values, and on the bench.

    `rail` is a factor on the rail pressure, `delay` of the meter [s], `gain` a factor on the measured values.
    """

    factors: Mapping[str, float] = {}
    sums: Mapping[str, float] = {}
    rail: float = 1.0
    delay: float = 0.0
    gain: float = 1.0


WRONGS: Mapping[str, Wrong] = {
    "delay 2 us": Wrong(delay=2e-6),
    "delay 6 us": Wrong(delay=6e-6),
    "gain 3 %": Wrong(gain=1.03),
    "friction 5 N": Wrong(sums={"plunger_needle.friction": 5.0}),
    "fuel 20 K": Wrong(sums={"fuel.temperature": 20.0}),
    "lift 10 %": Wrong(factors={"nozzle.lift_maximum_offset": 1.1}),
    "needle spring 20 %": Wrong(factors={"plunger_needle.spring_preload": 1.2}),
    "nozzle 3 %": Wrong(factors={"nozzle.hole_diameter": 1.03}),
    "magnet gap 20 %": Wrong(factors={"solenoid.residual_gap": 1.2}),
    "leakage, gap 40 %": Wrong(factors={"plunger_needle.plunger_gap": 1.4}),
    "rail sensor 2 %": Wrong(rail=1.02),
    "control volume 20 %": Wrong(factors={"control_chamber.volume": 1.2}),
    "seat flow 10 %": Wrong(factors={"needle_seat.discharge": 0.9}),
    "nozzle law 20 %": Wrong(factors={"nozzle.lift_transition_offset": 1.2}),
}


@dataclass(frozen=True)
class Bench:
    """A study, its mistake (empty for a right one), and the truth.

    Attributes
    ----------
    study : Study
    wrong : str
        Of `WRONGS`.
    noise : str
    truth : mapping of str to float
        Hidden values [SI] of the free parameters.
    unseen : (6,)
        True quantities [m³] at `UNSEEN`, as the wrong study sees them: without what the meter or the sensor adds.
    """

    study: cr.Study
    wrong: str
    noise: str
    truth: Mapping[str, float]
    unseen: Floats


def point_at(rail: float, time: float) -> cr.OperatingPoint:
    """Operating point at a rail pressure [Pa] and an energising time [s]."""
    return cr.OperatingPoint(rail, time, CYLINDER, RETURN, horizon=time + 3e-3)


def quantities(injector: cr.Injector, points: tuple[tuple[float, float], ...], step: float) -> Floats:
    """Quantities (n,) [m³] at rail pressures [Pa] and energising times [s], at a time step [s]."""
    batch = cr.simulate_batch(injector, [point_at(*at) for at in points], time_step=step, threads=1)
    density = [cr.simulate(injector, point_at(*points[0]), time_step=STEP).reference_density]
    return np.asarray(batch.injected_mass[0] / density)


def draw_bench(seed: int) -> Bench:
    """Bench and study of a seed."""
    rng = np.random.default_rng([seed, 17])
    injector = cr.load_injector(INJECTORS[seed % 2])
    injector = replace(injector, variant=injector.variant._replace(drive=Drive.REGULATED))
    free = FREE[int(rng.integers(len(FREE)))]
    possible = [name for name, mistake in WRONGS.items() if not set(mistake.factors) & set(free)]
    name = "" if rng.random() < RIGHT else possible[int(rng.integers(len(possible)))]
    noise = NOISES_USED[int(rng.integers(len(NOISES_USED)))]
    wrong = WRONGS[name] if name else Wrong()
    truth = {path: injector.values[path] * (1.0 + OFF * rng.uniform(-1.0, 1.0)) for path in free}
    changed = {path: injector.values[path] * factor for path, factor in wrong.factors.items()}
    changed |= {path: injector.values[path] + more for path, more in wrong.sums.items()}
    true = injector.with_values(truth | changed)
    late = wrong.delay + NOISES[noise].delay * rng.standard_normal()
    curves = [
        _curve(true, at, wrong, late, NOISES[noise].delay, noise, rng) for at in CURVES[: 1 + int(rng.integers(2))]
    ]
    with_map, with_unseen = rng.random() < 0.67, rng.random() < 0.5
    maps = [_map(true, MAP, wrong, cr.data.Role.FIT, rng)] if with_map else []
    maps += [_map(true, HELD_BACK, wrong, cr.data.Role.VALIDATION, rng)] if with_unseen else []
    units = injector.quantities
    parameters = [
        cr.Parameter(path, value, value * (1.0 - SPREAD), value * (1.0 + SPREAD), units[path].unit, mark="E", source="")
        for path, value in ((path, injector.values[path]) for path in free)
    ]
    method = cr.fit.Method(cr.fit.StagedSettings(members=128, generations=40, inversions=8), polish=3)
    study = cr.Study(f"bench {seed}", injector, (*curves, *maps), cr.fit.Space(parameters), method, 1, STEP)
    return Bench(study, name, noise, truth, quantities(true, UNSEEN, STEP / 4.0))


def _curve(
    true: cr.Injector,
    at: tuple[float, float],
    wrong: Wrong,
    late: float,
    stated: float,
    noise: str,
    rng: np.random.Generator,
) -> cr.RateData:
    """Rate curve at a point, `late` by [s]; the study states a standard deviation of that delay, 0 for none."""
    end = at[1] + 1.4e-3
    seen = replace(point_at(*at), horizon=end)
    solution = cr.simulate(true, replace(seen, rail_pressure=at[0] * wrong.rail), time_step=STEP / 4.0)
    bounds = np.arange(0.0, end + 0.5 * INTERVAL, INTERVAL)
    volume = np.interp(bounds - late, solution.time, solution.injected / solution.reference_density)
    rate = wrong.gain * np.diff(volume) / INTERVAL
    rate = rate + NOISES[noise].errors(rng, rate, INTERVAL, SIGMA)
    data = cr.RateData(f"{1e-6 * at[0]:.0f} MPa", cr.data.Role.FIT, seen, bounds, rate, 1.0, "bench", "")
    return data.changed(noise=Noise(uncertain={"delay": stated} if stated else {}))


def _map(
    true: cr.Injector,
    points: tuple[tuple[float, float], ...],
    wrong: Wrong,
    role: cr.data.Role,
    rng: np.random.Generator,
) -> cr.QuantityData:
    real = tuple((rail * wrong.rail, time) for rail, time in points)
    quantity = wrong.gain * quantities(true, real, STEP / 4.0)
    quantity = quantity + (ABSOLUTE + RELATIVE * quantity) * rng.standard_normal(len(quantity))
    seen = tuple(point_at(*at) for at in points)
    none = np.zeros(len(quantity), bool)
    weight = 100.0  # as `commonrail new` gives a map in addition to curves
    return cr.QuantityData(f"map {role.value}", role, seen, quantity, ABSOLUTE, RELATIVE, none, weight, "bench", "")
