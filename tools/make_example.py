"""Make the example curve of `commonrail new`: a declared truth on the slow reference engine, seen with noise.

    python -m tools.make_example                # write it where the templates are
    python -m tools.make_example --coverage 50  # fit fifty such curves with other noise, and print the errors

The truth is the example's injector with three values changed, which its study fits. Reference engine and fit share
the equations but neither discretisation nor noise: the example shows the result of a fit if the model is right.
"""

from __future__ import annotations

import argparse
import csv
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import commonrail as cr
from commonrail.calibration.identifiability import identify
from commonrail.calibration.objective import Objective

Floats = NDArray[np.float64]

TEMPLATES = Path(__file__).resolve().parents[1] / "src" / "commonrail" / "plugins" / "new" / "template"

TRUTH = {
    "control_chamber.z_hole_diameter": 0.211e-3,
    "control_chamber.a_hole_diameter": 0.268e-3,
    "nozzle.discharge_maximum": 0.80,
}
INTERVAL, END = 5e-6, 1600e-6  # of the samples [s]
POINT = cr.OperatingPoint(160e6, 700e-6, 5e6, 0.5e6, horizon=END)  # as study.toml states it
NOISE = 0.3e-6  # standard deviation of a sample [m³/s]
SEED = 1

HEAD = """\
# SYNTHETIC example, not measured: injector.toml with Z-hole 0.211 mm, A-hole 0.268 mm and c_d(zM) 0.80,
# simulated by commonrail's reference engine at 160 MPa and 700 us, with Gaussian noise of 0.3 mm3/ms (seed 1);
# made by tools/make_example.py. A sample is the mean rate over the 5 us that end at its time.
"""


class Fit(NamedTuple):
    """One fit of the example's study.

    `error` is estimate − true value of each parameter, in standard errors; `start_j`, `truth_j` and
    `best_j` are J at the start values, at the truth and at the best [mm³/ms].
    """

    error: dict[str, float]
    start_j: float
    truth_j: float
    best_j: float


def clean_rate() -> Floats:
    """Rate of injection of the truth without noise (samples,) [m³/s]."""
    injector = cr.load_injector(TEMPLATES / "injector.toml").with_values(TRUTH)
    solution = cr.simulate(injector, POINT, "reference", sample_interval=INTERVAL)
    if solution.status.failed:
        raise SystemExit(f"the example's truth: {solution.status.sentence}")
    return solution.rate


def noise(samples: int, seed: int = SEED) -> Floats:
    """Noise of the meter (samples,) [m³/s]."""
    return NOISE * np.random.default_rng(seed).standard_normal(samples)


def example_text(rate: Floats) -> str:
    """The file, given the rate with noise."""
    text = StringIO()
    text.write(HEAD)
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["time [us]", "rate [mm3/ms]"])
    for i, value in enumerate(rate, start=1):
        writer.writerow([f"{i * INTERVAL * 1e6:.0f}", f"{value * 1e6:.2f}"])
    return text.getvalue()


def fit(study: cr.Study, rate: Floats | None = None) -> Fit:
    """Calibrate the example's study, to another rate (samples,) than its own if one is given [m³/s]."""
    if rate is not None:
        (data,) = study.data
        study = replace(study, data=(replace(data, rate=rate),))
    calibration, names = cr.calibrate(study), study.space.names
    objective = Objective(study.injector, names, study.data, study.time_step)
    truth = np.array([[TRUTH[name] for name in names]])
    identified = identify(calibration)
    error = {name: (calibration.best[name] - TRUTH[name]) / identified[name]["standard_error"] for name in names}
    return Fit(error, calibration.start_cost, float(objective.costs(truth).costs[0]), calibration.cost)


def coverage(seeds: int) -> None:
    """Fit curves of seeds 1 to `seeds` and print how far from the truth each ends."""
    study, clean = cr.load_study(TEMPLATES / "study.toml"), clean_rate()
    errors = []
    for seed in range(1, seeds + 1):
        result = fit(replace(study, seed=seed), clean + noise(len(clean), seed))
        errors.append(list(result.error.values()))
        shown = ", ".join(f"{name.rpartition('.')[2]} {value:+.2f}" for name, value in result.error.items())
        print(
            f"seed {seed}: J {result.start_j:.0f} at the start, {result.truth_j:.1f} at the truth, {result.best_j:.1f}"
        )
        print(f"    found − true, in standard errors: {shown}")
    each = np.abs(np.array(errors))
    for limit in (1.0, 2.0, 3.0):
        print(f"within {limit:.0f} standard errors: {np.mean(each <= limit):.0%} of {each.size}")
    print(f"root mean square, in standard errors: {np.sqrt(np.mean(each**2, axis=0)).round(2).tolist()}")


def main() -> None:
    """Read the command line; write the example or measure the coverage."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--coverage", type=int, metavar="SEEDS", help="fit as many curves, and write nothing")
    args = parser.parse_args()
    if args.coverage:
        coverage(args.coverage)
        return
    clean = clean_rate()
    path = TEMPLATES / "data" / "evi.csv"
    path.write_text(example_text(clean + noise(len(clean))), encoding="utf-8")
    print(path)


if __name__ == "__main__":
    main()
