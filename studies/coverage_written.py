"""Coverage of the intervals that `calibrate` writes by itself, under noises that its likelihood does not assume.

    python -m studies.coverage_written                           # both beds, eight noises, 100 benches of each
    python -m studies.coverage_written proportional filtered --bed cri2-16 -n 60 --json found.json

A bench is a simulation of a hidden truth at a finer step than the fit's, with noise of a fixed seed (`noises.py`). It
is fitted as `calibrate` does at its end: from one start near the truth. Coverage is the share in % of 95 % intervals
that hold the truth, with verdicts confirmed or not; infinite intervals do not count. Its error is over benches, since
parameters of a bench err together. Width is the mean half width over 1.96 standard deviations of the estimates. "Wrong"
is the percentage of the determined parameters whose truth lies farther away than the verdict says.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import commonrail as cr
from commonrail.base.choices import Drive
from commonrail.calibration.identifiability import ParameterVerdict
from commonrail.data.noise import Noise
from studies.noises import NOISES, DrawnNoise

Floats = NDArray[np.float64]

SIGMA = 0.3e-6  # standard deviation of a sample, but for proportional noise [m³/s]
TRUE_STEP = 1e-7  # of the truth [s]
FIRST_SEED = 9000  # of the benches
NEAR = 0.05  # largest distance of the start from the values of the injector, as a share of them


@dataclass(frozen=True)
class Bed:
    """An injector at one point, and its free parameters.

    Attributes
    ----------
    injector : Injector
    point : OperatingPoint
    truth : mapping of str to float
        Hidden values [SI].
    middle : mapping of str to float
        Values [SI] about which the starts lie; the bounds are `spread` below and above.
    spread : float
    interval : float
        Of the samples [s].
    step : float
        Of the fit [s].
    """

    injector: cr.Injector
    point: cr.OperatingPoint
    truth: Mapping[str, float]
    middle: Mapping[str, float]
    spread: float
    interval: float
    step: float


def _solenoid() -> Bed:
    """The injector of a car at a middle pressure, chopped current: its likelihood ripples."""
    injector = cr.load_injector("cri2-16")
    factors = {"nozzle.hole_diameter": 1.01, "control_chamber.z_hole_diameter": 0.985, "valve.spring_preload": 1.03}
    middle = {name: injector.values[name] for name in factors}
    truth = {name: value * factors[name] for name, value in middle.items()}
    point = cr.OperatingPoint(120e6, 600e-6, horizon=1.9e-3)
    return Bed(injector, point, truth, middle, 0.2, 5e-6, 1e-6)


def _virtual() -> Bed:
    """The injector, point and parameters of `studies/coverage.py`, at the default step of a study."""
    injector = cr.load_injector("virtual-lino-2016")
    injector = replace(injector, variant=injector.variant._replace(drive=Drive.REGULATED))
    truth = {"nozzle.discharge_maximum": 0.8, "control_chamber.a_hole_diameter": 0.262e-3, "plunger_needle.k7": 6e7}
    return Bed(injector, cr.OperatingPoint(160e6, 700e-6, horizon=1.56e-3), truth, truth, 0.3, 3e-6, 1e-6)


BEDS = {"cri2-16": _solenoid, "virtual-lino-2016": _virtual}


class Benches:
    """All benches of a bed: the truth is simulated once.

    Parameters
    ----------
    bed : Bed
    """

    def __init__(self, bed: Bed) -> None:
        self.bed = bed
        true = cr.simulate(bed.injector.with_values(dict(bed.truth)), bed.point, time_step=TRUE_STEP)
        self.time, self.injected = true.time, true.injected / true.reference_density
        self.bounds = np.arange(0.0, bed.point.horizon + 0.5 * bed.interval, bed.interval)
        quantities = bed.injector.quantities
        self.space = cr.fit.Space(
            [
                cr.Parameter(
                    name,
                    value,
                    value * (1.0 - bed.spread),
                    value * (1.0 + bed.spread),
                    quantities[name].unit,
                    mark="E",
                    source="virtual",
                )
                for name, value in bed.middle.items()
            ]
        )

    def rate(self, delay: float = 0.0) -> Floats:
        """True mean rates between the bounds (n,), later by a delay [s]."""
        return np.asarray(np.diff(np.interp(self.bounds - delay, self.time, self.injected)) / self.bed.interval)

    def study(self, noise: DrawnNoise, seed: int) -> tuple[cr.Study, dict[str, float]]:
        """Study of a bench, and the values [SI] from which the fit starts."""
        rng, bed = np.random.default_rng(FIRST_SEED + seed), self.bed
        rate = self.rate(noise.delay * rng.standard_normal())
        rate = rate + noise.errors(rng, rate, bed.interval, SIGMA)
        stated = Noise(uncertain={"delay": noise.delay} if noise.delay else {})
        data = cr.RateData("curve", cr.data.Role.FIT, bed.point, self.bounds, rate, 1.0, "", "virtual").changed(
            noise=stated
        )
        start = {name: value * (1.0 + NEAR * rng.uniform(-1.0, 1.0)) for name, value in bed.middle.items()}
        return cr.Study("bench", bed.injector, (data,), self.space, cr.fit.Method(), 1, bed.step), start


@dataclass(frozen=True)
class Coverage:
    """Figures of a bed under a noise; percentages, and simulations and processor time [s] of a fit."""

    bed: str
    noise: str
    benches: int
    each: list[float]
    every: float
    error: float
    widths: list[float]
    determined: float
    wrong: float
    withdrawn: float
    refused: float
    failed: int
    simulations: float
    seconds: float


def measure_coverage(bed: str, noise: str, many: int, limit: float = np.inf) -> Coverage:
    """Figures of the first benches of a bed under a noise.

    Parameters
    ----------
    bed, noise : str
    many : int
    limit : float
        Processor time [s] after which no further bench is begun.
    """
    benches, begin = Benches(BEDS[bed]()), time.process_time()
    truth = np.array(list(benches.bed.truth.values()))
    rows: list[tuple[Floats, ...]] = []
    withdrawn, simulations, failed = 0, 0, 0
    for seed in range(many):
        if time.process_time() - begin > limit:
            break
        study, start = benches.study(NOISES[noise], seed)
        try:
            certainty = cr.certainty(study, start, threads=1)
        except cr.errors.SimulationError:
            failed += 1
            continue
        withdrawn += bool(certainty.withdrawn)
        simulations += certainty.estimate.simulated
        determined = np.array([v.verdict is ParameterVerdict.DETERMINED for v in certainty.verdicts])
        half = np.array([v.half for v in certainty.verdicts])
        rows.append((certainty.estimate.point[: certainty.d], certainty.low, certainty.high, determined, half))
    point, low, high, determined, half = (np.array(column) for column in zip(*rows, strict=True))
    return Coverage(
        bed,
        noise,
        len(rows),
        **_coverage(truth, point, low, high),
        determined=_percent(determined),
        wrong=_percent((np.abs(point - truth) > half)[determined]) if determined.any() else 0.0,
        withdrawn=100.0 * withdrawn / len(rows),
        failed=failed,
        simulations=simulations / len(rows),
        seconds=(time.process_time() - begin) / len(rows),
    )


def _coverage(truth: Floats, point: Floats, low: Floats, high: Floats) -> dict[str, object]:
    """Coverage of each parameter and of all with its error, widths, and the share of infinite intervals."""
    finite = np.isfinite(high) & np.isfinite(low)
    covered = np.where(finite, (low <= truth) & (truth <= high), np.nan)
    every = float(np.nanmean(covered))
    half = np.nanmean(np.where(finite, 0.5 * (high - low), np.nan), axis=0)
    return {
        "each": (100.0 * np.nanmean(covered, axis=0)).tolist(),
        "every": 100.0 * every,
        "error": 100.0 * float(np.sqrt(every * (1.0 - every) / len(point))),
        "widths": (half / (1.96 * np.std(point, axis=0, ddof=1))).tolist(),
        "refused": 100.0 - _percent(finite),
    }


def _percent(flags: Floats) -> float:
    return float(100.0 * np.mean(flags))


HEAD = """\
| bed | noise | benches | coverage of each, % | all, % | width | determined, % | wrong, % | withdrawn, % | \
refused, % | failed | simulations, s a fit |
|---|---|---|---|---|---|---|---|---|---|---|---|"""


def line(r: Coverage) -> str:
    """Figures as a line of the table."""
    each, widths = " ".join(f"{v:.0f}" for v in r.each), " ".join(f"{v:.2f}" for v in r.widths)
    return (
        f"| {r.bed} | {r.noise} | {r.benches} | {each} | {r.every:.1f} ± {r.error:.1f} | {widths} | "
        f"{r.determined:.0f} | {r.wrong:.1f} | {r.withdrawn:.0f} | {r.refused:.0f} | {r.failed} | "
        f"{r.simulations:.0f}, {r.seconds:.2f} |"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("noise", nargs="*", metavar="NOISE", help=f"of {', '.join(NOISES)}; all by default")
    parser.add_argument("--bed", choices=list(BEDS), help="both by default")
    parser.add_argument("-n", type=int, default=100, help="benches of each noise [default: 100]")
    parser.add_argument("--limit", type=float, default=np.inf, help="processor time of each noise [s]")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures there too")
    args = parser.parse_args(arguments)
    if unknown := [name for name in args.noise if name not in NOISES]:
        parser.error(f"there is no noise {unknown[0]}; there are {', '.join(NOISES)}")
    print(HEAD)
    rows = []
    for bed in [args.bed] if args.bed else BEDS:
        for noise in args.noise or NOISES:
            rows.append(measure_coverage(bed, noise, args.n, args.limit))
            print(line(rows[-1]), flush=True)
            if args.json:
                args.json.write_text(json.dumps([asdict(row) for row in rows], indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
