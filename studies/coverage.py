"""Coverage of the stated intervals on virtual benches whose truth the fit never sees.

    python -m studies.coverage                       # 400 benches of every bed; a table, and what misses its promise
    python -m studies.coverage white "delay 2 us" -n 60

A bench is the fast engine's own simulation of a hidden truth, with noise of a fixed seed, fitted as `commonrail
certainty` does. Coverage is the percentage of 95 % intervals that hold the truth; width is the half-width over 1.96
standard deviations of the estimates over all benches (1 is honest and efficient). "Wrong" is the percentage of the
parameters called determined whose truth lies farther away than the verdict says, "alarms" the share of benches whose
residuals are found to be no noise.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import commonrail as cr
from commonrail.base.choices import Drive
from commonrail.calibration.identifiability import ParameterVerdict
from commonrail.data.base import DataSet
from commonrail.data.noise import NOISE, Correlation, Noise
from commonrail.data.simulator import Simulator
from commonrail.plugins.certainty.estimate import estimate, library, starts_from
from commonrail.plugins.certainty.file import Certainty
from commonrail.plugins.certainty.likelihood import Likelihood
from commonrail.plugins.certainty.run import assess, drawn
from commonrail.plugins.certainty.uncertain import with_uncertain_free

Floats = NDArray[np.float64]
Draw = Callable[[np.random.Generator, int], Floats]

STEP, TRUE_STEP = 1.5e-6, 1e-7  # of the fit and of the truth, whose own error a fit at its step would share [s]
INTERVAL, END = 3e-6, 1.56e-3  # of the samples [s]
CURVE = cr.OperatingPoint(160e6, 700e-6, horizon=END)
MAP = [cr.OperatingPoint(p * 1e6, t * 1e-6) for p in (60, 100, 160) for t in (300, 500, 700, 1000)]
SIGMA = 0.3e-6  # standard deviation of a sample [m³/s]
TOLERANCE = 0.05e-9  # of a quantity: the standard deviation of its error [m³]
THREE = {"nozzle.discharge_maximum": 0.8, "control_chamber.a_hole_diameter": 0.262e-3, "plunger_needle.k7": 6.0e7}
SEVEN = {f"plunger_needle.k{i}": cr.lab.PAPER_OPTIMUM[f"plunger_needle.k{i}"] for i in range(1, 8)}
ORDER = "k7 < k2 < k3 < k5 < k4 < k1 < k6".replace("k", "plunger_needle.k")
FRICTION = {"plunger_needle.friction": 5.0, "plunger_needle.viscous": 2.0}  # [N], [N s/m] of each guide
TEMPERATURE, KELVIN = 313.15, 3.0  # of the fuel: middle and standard deviation of what a bench draws [K]
MEMBERS = 1024  # of the library that starts are chosen from, simulated once for all benches


def white(rng: np.random.Generator, n: int) -> Floats:
    """Independent samples."""
    return rng.standard_normal(n)


def autoregressive(rng: np.random.Generator, n: int) -> Floats:
    """Noise whose autocorrelation is 0.9 at lag one."""
    noise = rng.standard_normal(n)
    for i in range(1, n):
        noise[i] = 0.9 * noise[i - 1] + np.sqrt(1.0 - 0.81) * noise[i]
    return noise


def with_outliers(rng: np.random.Generator, n: int) -> Floats:
    """White noise, one sample in ten eight times as large."""
    return rng.standard_normal(n) * np.where(rng.random(n) < 0.1, 8.0, 1.0)


@dataclass(frozen=True)
class Bed:
    """Benches of one kind.

    Attributes
    ----------
    promise : Promise
    truth : mapping of str to float
        Free parameters and their hidden values [SI].
    noise : function of Generator and n
        Errors of the samples of a curve, in standard deviations.
    curve, quantities : bool
        Data of the bench.
    stated : Noise
        Statement of the study on the curve's noise.
    starts : int
    spread : (float, float)
        Bounds below and above the truth, as shares of it.
    constraints : tuple of str
    delay : float
        Delay of the meter that the fit lacks [s].
    delay_deviation : float
        Standard deviation of a delay that each bench draws [s].
    temperature : bool
        The fuel temperature is free, with a prior that each bench draws its own from.
    hidden : mapping of str to float
        Values that each bench draws as |normal| with this standard deviation; the model lacks them, or they are stated.
    """

    promise: Promise
    truth: Mapping[str, float] = field(default_factory=lambda: THREE)
    noise: Draw = white
    curve: bool = True
    quantities: bool = False
    stated: Noise = NOISE
    starts: int = 4
    spread: tuple[float, float] = (0.3, 0.3)
    constraints: tuple[str, ...] = ()
    delay: float = 0.0
    delay_deviation: float = 0.0
    temperature: bool = False
    hidden: Mapping[str, float] = field(default_factory=dict)


class Promise(NamedTuple):
    """Ranges in percent that the figures of a bed are to lie in; None where nothing is promised.

    Attributes
    ----------
    every : (float, float) or None
        Coverage over all printed intervals.
    each : (float, float) or None
        Coverage of each parameter.
    width : (float, float) or None
    wrong : float or None
        Largest share of parameters wrongly called determined.
    alarms : (float, float) or None
        Share of benches whose residuals are found to be no noise.
    """

    every: tuple[float, float] | None = None
    each: tuple[float, float] | None = None
    width: tuple[float, float] | None = None
    wrong: float | None = None
    alarms: tuple[float, float] | None = None


# A half width holds the error of the time step too, which does not scatter: up to 1.5 times the scatter was measured.
HONEST = Promise((93, 97), (90, 99), (0.9, 1.6), 7, (0, 3))
DELAYED = Promise(every=(92, 97), wrong=7)
LACKING = Promise(every=(90, 98), wrong=7)


def _delay(deviation: float, noise: Draw = white) -> Bed:
    return Bed(DELAYED, noise=noise, stated=Noise(uncertain={"delay": deviation}), delay_deviation=deviation)


BEDS: dict[str, Bed] = {
    "white": Bed(HONEST),
    "autoregressive": Bed(HONEST, noise=autoregressive),
    "outliers": Bed(HONEST, noise=with_outliers),
    "curve and map": Bed(HONEST, quantities=True),
    "map": Bed(HONEST, curve=False, quantities=True),
    "temperature free": Bed(HONEST, temperature=True),
    "delay 0.2 us": _delay(0.2e-6),
    "delay 0.5 us": _delay(0.5e-6),
    "delay 2 us": _delay(2e-6),
    "delay 0.2 us, autoregressive": _delay(0.2e-6, autoregressive),
    "delay 0.5 us, autoregressive": _delay(0.5e-6, autoregressive),
    "delay 1 us, autoregressive": _delay(1e-6, autoregressive),
    "seven in order": Bed(Promise(every=(90, 98), wrong=7), SEVEN, starts=8, spread=(0.9, 0.9), constraints=(ORDER,)),
    "unstated delay 5 us, known white": Bed(
        Promise(alarms=(90, 100)), stated=Noise(correlation=Correlation.WHITE), delay=5e-6
    ),
    "unstated delay 5 us, autoregressive": Bed(Promise(alarms=(90, 100)), noise=autoregressive, delay=5e-6),
    "unstated delay 1.95 us": Bed(Promise(alarms=(85, 95)), delay=1.95e-6),
    "unstated delay 2.75 us, autoregressive": Bed(Promise(alarms=(85, 95)), noise=autoregressive, delay=2.75e-6),
    "friction, stated as uncertain": Bed(LACKING, stated=Noise(uncertain=FRICTION), hidden=FRICTION),
    "friction that nobody has stated": Bed(Promise(wrong=7), hidden=FRICTION),
    "friction and delay 1 us, stated": Bed(
        LACKING,
        noise=autoregressive,
        stated=Noise(uncertain={"delay": 1e-6, **FRICTION}),
        delay_deviation=1e-6,
        hidden=FRICTION,
    ),
}


class Bench(NamedTuple):
    """Study of one bench, and the hidden values [SI] of its free parameters."""

    study: cr.Study
    truth: Floats


class Benches:
    """All benches of a bed: what they share is simulated once.

    Parameters
    ----------
    bed : Bed
    """

    def __init__(self, bed: Bed) -> None:
        self.bed = bed
        injector = cr.load_injector("virtual-lino-2016")
        self.injector = replace(injector, variant=injector.variant._replace(drive=Drive.REGULATED))
        (low, high), units = bed.spread, cr.models.parameter_quantities()
        parameters = [
            cr.Parameter(n, v, v * (1 - low), v * (1 + high), units[n].unit, mark="E", source="virtual")
            for n, v in bed.truth.items()
        ]
        if bed.temperature:
            prior = cr.Prior(TEMPERATURE, KELVIN, "virtual")
            bounds = TEMPERATURE, TEMPERATURE - 6 * KELVIN, TEMPERATURE + 6 * KELVIN
            parameters.append(cr.Parameter("fuel.temperature", *bounds, "K", mark="E", source="virtual", prior=prior))
        self.space = cr.fit.Space(parameters, bed.constraints)
        self.bounds = np.arange(0.0, END + 0.5 * INTERVAL, INTERVAL)
        self.first = Likelihood.of(with_uncertain_free(self.bench(0).study), 1)
        self.library = library(self.first, MEMBERS, seed=5)

    def bench(self, seed: int) -> Bench:
        """Bench of a seed; the fit knows its data and the bounds."""
        bed, rng = self.bed, np.random.default_rng(1000 + seed)
        truth = list(bed.truth.values())
        if bed.temperature:
            truth.append(TEMPERATURE + KELVIN * rng.standard_normal())
        hidden = {name: deviation * abs(rng.standard_normal()) for name, deviation in bed.hidden.items()}
        delay = bed.delay + bed.delay_deviation * rng.standard_normal()
        values = dict(zip(self.space.names, truth, strict=True)) | hidden
        data: list[DataSet] = []
        if bed.curve:
            meter = cr.Meter("bench", {"delay": delay}) if delay else None
            rate = self._seen(self._curve(np.zeros(len(self.bounds) - 1), meter), values)
            rate = rate + SIGMA * bed.noise(rng, len(rate))
            data.append(self._curve(rate).changed(noise=bed.stated))
        if bed.quantities:
            quantity = self._seen(self._map(np.zeros(len(MAP))), values)
            data.append(self._map(quantity + TOLERANCE * rng.standard_normal(len(quantity))))
        return Bench(
            cr.Study("bench", self.injector, tuple(data), self.space, cr.fit.Method(), 1, STEP), np.array(truth)
        )

    def _curve(self, rate: Floats, meter: cr.Meter | None = None) -> cr.RateData:
        return cr.RateData("curve", cr.data.Role.FIT, CURVE, self.bounds, rate, 1.0, "", "virtual", meter=meter)

    def _map(self, quantity: Floats) -> cr.QuantityData:
        dead = np.zeros(len(quantity), bool)
        return cr.QuantityData("map", cr.data.Role.FIT, MAP, quantity, TOLERANCE, 0.0, dead, 1.0, "", "virtual")

    def _seen(self, data: DataSet, values: Mapping[str, float]) -> Floats:
        """Values of a truth as the bench shows them."""
        simulator = Simulator(self.injector, tuple(values), TRUE_STEP, 1)
        return data.simulated(simulator, np.array([list(values.values())]))[0]

    def fit(self, bench: Bench) -> Certainty:
        """Certainty of a bench from members of the library."""
        study = with_uncertain_free(bench.study)
        likelihood = Likelihood.of(study, 1)
        shifts = [a.at_zero - b.at_zero for a, b in zip(likelihood.blocks, self.first.blocks, strict=True)]
        unit, errors = self.library
        starts = starts_from(likelihood, (unit, errors + np.concatenate(shifts)), self.bed.starts)
        result, draws = drawn(estimate(likelihood, starts, first=self.space.dimension), 0)
        return assess(study, result, draws, self.space.dimension, {}, threads=1)


class Row(NamedTuple):
    """Figures of a bed: coverage of each parameter and of all, widths, half-widths in percent of the value, share of
    intervals printed, determined parameters, wrong ones among them, alarms, simulations and processor time of a fit."""

    benches: int
    each: Floats
    every: float
    widths: Floats
    halves: Floats
    printed: float
    determined: float
    wrong: float
    alarms: float
    simulations: float
    seconds: float


def measure_bed(bed: Bed, many: int) -> Row:
    """Figures of the first benches of a bed."""
    benches = Benches(bed)
    errors, inside, half, printed, determined, right, alarms, cost = ([] for _ in range(8))
    for seed in range(many):
        bench = benches.bench(seed)
        begin = time.process_time()
        fit = benches.fit(bench)
        cost.append((fit.estimate.simulated, time.process_time() - begin))
        low, high, point = fit.low, fit.high, fit.estimate.point[: fit.d]
        errors.append(point - bench.truth)
        inside.append((low <= bench.truth) & (bench.truth <= high))
        half.append(0.5 * (high - low) / bench.truth)
        printed.append(np.full(len(low), fit.estimate.settled and not fit.draws.refusal))
        determined.append([j.verdict is ParameterVerdict.DETERMINED for j in fit.verdicts])
        right.append(np.abs(point - bench.truth) <= [j.half for j in fit.verdicts])
        alarms.append(any(test.detected for test in fit.tests))
    covered, shown, called = np.array(inside), np.array(printed), np.array(determined)
    relative = np.std(errors, axis=0, ddof=1) / benches.bench(0).truth
    mean = np.array([np.mean(h[s]) if s.any() else np.nan for h, s in zip(np.array(half).T, shown.T, strict=True)])
    return Row(
        many,
        np.array([_percent(h[s]) for h, s in zip(covered.T, shown.T, strict=True)]),
        _percent(covered[shown]),
        mean / (1.96 * relative),
        100.0 * mean,
        _percent(shown),
        _percent(called),
        100.0 - _percent(np.array(right)[called]) if called.any() else 0.0,
        _percent(np.array(alarms)),
        *np.mean(cost, axis=0).tolist(),
    )


def _percent(flags: Floats) -> float:
    return float(100.0 * np.mean(flags)) if np.size(flags) else float("nan")


def misses(figures: Row, promise: Promise) -> list[str]:
    """Promises that the figures of a bed do not keep, in words."""

    def outside(values: Floats | float, limits: tuple[float, float] | None) -> bool:
        return limits is not None and not bool(
            np.all((np.array(values) >= limits[0]) & (np.array(values) <= limits[1]))
        )

    return [
        f"{what} outside {limits[0]:g} to {limits[1]:g}"
        for what, values, limits in (
            ("coverage", figures.every, promise.every),
            ("coverage of a parameter", figures.each, promise.each),
            ("width", figures.widths, promise.width),
            ("wrongly determined", figures.wrong, None if promise.wrong is None else (0.0, promise.wrong)),
            ("alarms", figures.alarms, promise.alarms),
        )
        if limits is not None and outside(values, limits)
    ]


HEAD = """\
| bed | benches | coverage of each, % | all, % | width | half-width, % | printed, % | determined, % | wrong, % | \
alarms, % | simulations, s a fit |
|---|---|---|---|---|---|---|---|---|---|---|"""


def line(name: str, r: Row) -> str:
    """Figures of a bed as a line of the table."""
    each, widths = (" ".join(f"{v:{form}}" for v in values) for values, form in ((r.each, ".0f"), (r.widths, ".2f")))
    halves = " ".join(f"{v:.2g}" for v in r.halves)
    error = np.sqrt(r.every * (100.0 - r.every) / r.benches)
    effort = f"{r.simulations:.0f}, {r.seconds:.2f}"
    return (
        f"| {name} | {r.benches} | {each} | {r.every:.1f} ± {error:.1f} | {widths} | {halves} | {r.printed:.0f} | "
        f"{r.determined:.0f} | {r.wrong:.1f} | {r.alarms:.1f} | {effort} |"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; return 1 if a promise is not kept."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bed", nargs="*", metavar="BED", help=f"of {', '.join(BEDS)}; all by default")
    parser.add_argument("-n", type=int, default=400, help="benches of each bed [default: 400]")
    args = parser.parse_args(arguments)
    if unknown := [name for name in args.bed if name not in BEDS]:
        parser.error(f"there is no bed {unknown[0]}")
    print(HEAD)
    missed = 0
    for name in args.bed or BEDS:
        figures = measure_bed(BEDS[name], args.n)
        lacking = misses(figures, BEDS[name].promise)
        missed += bool(lacking)
        print(line(name, figures), *(f"\n    {name}: {words}" for words in lacking), flush=True)
    return int(missed > 0)


if __name__ == "__main__":
    raise SystemExit(main())
