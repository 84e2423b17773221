"""Coverage of the stated intervals on virtual benches whose truth the fit never sees.

    python -m tools.coverage                    # 400 benches of every bed; a table, and a judgement of each figure
    python -m tools.coverage white delay -n 60  # some beds, fewer benches

A bench is the lanes' own simulation of a hidden truth with noise of a fixed seed, fitted by what `commonrail certainty`
uses. Coverage is the percentage of 95 % intervals that hold the truth; width is the half-width over 1.96 standard
deviations of the estimates over all benches (1 is honest and efficient).
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import commonrail as cr
from commonrail.analysis.certainty.estimate import Estimate, estimate, library, starts_from
from commonrail.analysis.certainty.likelihood import Likelihood
from commonrail.injector.variants import Drive
from commonrail.kinds import DataSet
from commonrail.kinds.noise import NOISE, Noise
from commonrail.kinds.simulator import Simulator

Floats = NDArray[np.float64]

STEP = 1.5e-6  # [s]
INTERVAL, END = 3e-6, 1.56e-3  # of the samples [s]
CURVE = cr.OperatingPoint(160e6, 700e-6, horizon=END)
MAP = [cr.OperatingPoint(p * 1e6, t * 1e-6) for p in (60, 100, 160) for t in (300, 500, 700, 1000)]
SIGMA = 0.3e-6  # standard deviation of a sample [m³/s]
ABSOLUTE, RELATIVE = 0.05e-9, 0.0005  # tolerance of a quantity [m³]
THREE = {
    "nozzle.discharge_maximum": 0.8,
    "control_chamber.a_hole_diameter": 0.262e-3,
    "plunger_needle.k7": 6.0e7,
}
SEVEN = {f"plunger_needle.k{i}": cr.PAPER_OPTIMUM[f"plunger_needle.k{i}"] for i in range(1, 8)}
ORDER = "k7 < k2 < k3 < k5 < k4 < k1 < k6".replace("k", "plunger_needle.k")
MEMBERS = 1024  # of the library that starts are chosen from, simulated once for all benches


@dataclass(frozen=True)
class Bed:
    """Benches of one kind.

    Attributes
    ----------
    truth : mapping of str to float
        Free parameters and their hidden values [SI].
    noise : function of Generator and n
        Errors of the samples of a curve, in standard deviations.
    curve, quantities : bool
        Data of the bench.
    outliers : float
        Share of a map's quantities whose error is eight times as large.
    stated : Noise
        What the study says of the curve's noise.
    starts : int
    spread : float
        Bounds about the truth, as a share of it.
    constraints : tuple of str
    hidden : mapping of str to float
        Standard deviations of what the truth draws and the study does not fit.
    """

    truth: Mapping[str, float] = field(default_factory=lambda: THREE)
    noise: Callable[[np.random.Generator, int], Floats] = lambda rng, n: rng.standard_normal(n)
    curve: bool = True
    quantities: bool = False
    outliers: float = 0.0
    stated: Noise = NOISE
    starts: int = 4
    spread: float = 0.3
    constraints: tuple[str, ...] = ()
    hidden: Mapping[str, float] = field(default_factory=dict)


def autoregressive(rng: np.random.Generator, n: int) -> Floats:
    """Noise whose autocorrelation is 0.9 at lag one."""
    found = rng.standard_normal(n)
    for i in range(1, n):
        found[i] = 0.9 * found[i - 1] + np.sqrt(1.0 - 0.81) * found[i]
    return found


def with_outliers(rng: np.random.Generator, n: int) -> Floats:
    """White noise, one sample in ten eight times as large."""
    return rng.standard_normal(n) * np.where(rng.random(n) < 0.1, 8.0, 1.0)


BEDS: dict[str, Bed] = {
    "white": Bed(),
    "autoregressive": Bed(noise=autoregressive),
    "outliers": Bed(noise=with_outliers),
    "curve and map": Bed(quantities=True),
    "map": Bed(curve=False, quantities=True),
}


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
        self.names = tuple(bed.truth)
        self.truth = np.array(list(bed.truth.values()))
        self.space = cr.Space(
            [
                cr.Parameter(n, v, v * (1 - bed.spread), v * (1 + bed.spread), "1", mark="E", source="virtual")
                for n, v in bed.truth.items()
            ],
            bed.constraints,
        )
        self.bounds = np.arange(0.0, END + 0.5 * INTERVAL, INTERVAL)
        self._clean: dict[str, Floats] = {}
        self.library = library(Likelihood.of(self.study(0), 1), MEMBERS, seed=5)

    def data(self, seed: int) -> list[DataSet]:
        """Data of a bench."""
        rng = np.random.default_rng(1000 + seed)
        found: list[DataSet] = []
        if self.bed.curve:
            rate = self.rate() + SIGMA * self.bed.noise(rng, len(self.bounds) - 1)
            found.append(
                cr.RateData("curve", cr.Role.FIT, CURVE, self.bounds, rate, 1.0, "", "all", noise=self.bed.stated)
            )
        if self.bed.quantities:
            quantity = self.quantity()
            factor = np.where(rng.random(len(quantity)) < self.bed.outliers, 8.0, 1.0)
            noisy = quantity + (ABSOLUTE + RELATIVE * quantity) * factor * rng.standard_normal(len(quantity))
            dead = np.zeros(len(noisy), bool)
            found.append(cr.QuantityData("map", cr.Role.FIT, MAP, noisy, ABSOLUTE, RELATIVE, dead, 1.0, "", "all"))
        return found

    def rate(self) -> Floats:
        """Rates of the truth [m³/s]."""
        if "rate" not in self._clean:
            empty = cr.RateData("", cr.Role.FIT, CURVE, self.bounds, np.zeros(len(self.bounds) - 1), 1.0, "", "all")
            self._clean["rate"] = empty.simulated(Simulator(self.injector, self.names, STEP, 1), self.truth[None])[0]
        return self._clean["rate"]

    def quantity(self) -> Floats:
        """Quantities of the truth [m³]."""
        if "quantity" not in self._clean:
            batch = cr.simulate_batch(self.injector, MAP, self.names, self.truth[None], time_step=STEP, threads=1)
            self._clean["quantity"] = batch.injected_volume[0]
        return self._clean["quantity"]

    def study(self, seed: int) -> cr.Study:
        """Study of a bench, which knows nothing of its truth but the middle of the bounds."""
        return cr.Study("bench", self.injector, tuple(self.data(seed)), self.space, cr.Method(), 1, STEP)

    def fit(self, seed: int) -> Estimate:
        """Estimate of a bench."""
        likelihood = Likelihood.of(self.study(seed), 1)
        unit, errors = self.library
        return estimate(likelihood, starts_from(likelihood, (unit, errors + self._moved(likelihood)), self.bed.starts))

    def _moved(self, likelihood: Likelihood) -> Floats:
        """Difference (n,) between residuals of this bench and those of the first, whose library it is."""
        first = Likelihood.of(self.study(0), 1)
        return np.concatenate([a.at_zero - b.at_zero for a, b in zip(likelihood.blocks, first.blocks, strict=True)])


class Row(NamedTuple):
    """Figures of a bed."""

    coverage: list[float]
    every: float
    widths: list[float]
    halves: list[float]
    simulations: float
    seconds: float


def row(bed: Bed, many: int, say: Callable[[str], None] = lambda _: None) -> Row:
    """Figures of the first benches of a bed."""
    benches = Benches(bed)
    found, inside, half, sims = [], [], [], []
    benches.fit(0)
    start = time.process_time()
    for seed in range(many):
        one = benches.fit(seed)
        low, high = one.interval()
        found.append(one.point)
        inside.append((low <= benches.truth) & (benches.truth <= high))
        half.append(0.5 * (high - low))
        sims.append(one.simulated)
    seconds = (time.process_time() - start) / many
    spread = np.std(found, axis=0, ddof=1)
    mean = np.mean(half, axis=0)
    return Row(
        (100 * np.mean(inside, axis=0)).tolist(),
        float(100 * np.mean(inside)),
        (mean / (1.96 * spread)).tolist(),
        (100 * mean / benches.truth).tolist(),
        float(np.mean(sims)),
        seconds,
    )


def line(name: str, found: Row) -> str:
    """Figures of a bed as a line of the table."""
    each = " ".join(f"{c:.0f}" for c in found.coverage)
    widths = " ".join(f"{w:.2f}" for w in found.widths)
    halves = " ".join(f"{h:.3g}" for h in found.halves)
    return (
        f"| {name} | {each} | {found.every:.1f} | {widths} | {halves} | {found.simulations:.0f}, {found.seconds:.3f} |"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("bed", nargs="*", metavar="BED", help=f"of {', '.join(BEDS)}")
    parser.add_argument("-n", type=int, default=400)
    parser.add_argument("--json", type=Path)
    own = parser.parse_args(arguments)
    for name in own.bed or BEDS:
        found = row(BEDS[name], own.n)
        print(line(name, found), flush=True)
        if own.json:
            own.json.write_text(json.dumps(found._asdict()))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
