"""Virtual bench of a calibration engineer's day, and the verdicts of many such days. All of its data are SYNTHETIC.

    python -m studies.walk_bench files DIR --seed 3      # map.xlsx, record.mf4, the study that fits them, truth.json
    python -m studies.walk_bench seeds DIR --count 40    # files, fit and verdict of forty benches, and a table
    python -m studies.walk_bench table DIR               # the table of the benches so far

A bench has a CRI2-16 of which nine values are drawn about those of the catalogue, simulated at a finer step than the
fit's: a quantity map in mg per stroke as text with decimal commas, and a record of 120 shots on four rasters whose
trigger comes 1.7 ms early, seen by a rate meter of two poles of 12 kHz and 18 us of delay. Shots scatter by 0.8 %.
Eight of the values are fitted, with the delay; the armature lift is measured. `--wrong 0.2` states instead an armature
lift and a quench voltage that are wrong by 20 %: such a fit must not be called usable.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, lfilter

import commonrail as cr

Floats = NDArray[np.float64]

INJECTOR = "cri2-16"
# standard deviation of a value about the catalogue's, of parts of one type as drawings tolerate them
SPREAD = {
    "control_chamber.a_hole_diameter": 0.03,
    "control_chamber.z_hole_diameter": 0.03,
    "valve.spring_preload": 0.04,
    "solenoid.eddy_lag": 0.08,
    "plunger_needle.plunger_diameter": 0.005,
    "plunger_needle.spring_preload": 0.08,
    "needle_seat.diameter": 0.03,
    "nozzle.discharge_maximum": 0.02,
}
LIFT, DELAY, POLE = "valve.lift", 18e-6, 12e3  # measured; of the meter [s], [Hz]
CYLINDER, RETURN = "0.5 MPa", "0.1 MPa"
MAP_RAIL, MAP_TIME = (400, 700, 1000, 1300, 1600), (200, 250, 300, 350, 400, 500, 600, 700, 850, 1000)  # bar, us
SHOT_POINTS = ((600, 300), (600, 700), (900, 400), (900, 800), (1400, 300), (1400, 700))
EACH, SPACING, EARLY = 20, 10e-3, 1.7e-3  # shots of a point; between two [s]; trigger before energising [s]
RASTERS = {"rate": 5e-6, "current": 10e-6, "pressure": 20e-6, "set points": SPACING}  # [s]
FINE, LASTING = 0.25e-6, 5e-3  # step of the truth, what of a shot is seen [s]
HALF_SAMPLE = 0.5 * RASTERS["rate"]  # an edge is found midway between two samples, before the shot's first one
RATE_NOISE, MAP_NOISE, SCATTER = 0.3, 0.006, 0.008  # mm³/ms; relative; of whole shots, relative
SCALE = 1e9  # mm³ of a m³


def true_values(seed: int) -> dict[str, float]:
    """Hidden values [SI] of a bench."""
    random, nominal = np.random.default_rng([seed, 1]), cr.load_injector(INJECTOR).values
    return {name: nominal[name] * (1.0 + spread * random.standard_normal()) for name, spread in SPREAD.items()} | {
        LIFT: nominal[LIFT] * (1.0 + 0.03 * random.standard_normal())
    }


def metered_rate(injector: cr.Injector, rail: int, time: int) -> Floats:
    """Rates [mm³/ms] that the meter shows at 0, 5 us … after the trigger."""
    point = cr.OperatingPoint(1e5 * rail, 1e-6 * time, CYLINDER, RETURN, horizon=LASTING - EARLY)
    solution = cr.simulate(injector, point, time_step=FINE)
    moments = np.arange(0.0, LASTING, 1e-6)  # from the trigger
    volume = SCALE * np.interp(moments - EARLY - DELAY, solution.time, solution.injected / solution.reference_density)
    lag = butter(1, POLE, fs=1e6)
    slow = lfilter(*lag, lfilter(*lag, volume))
    bounds = np.arange(0.0, LASTING, RASTERS["rate"])
    shown: Floats = np.diff(np.interp(bounds, moments, slow), prepend=0.0) / (1e3 * RASTERS["rate"])
    return shown


def write_map(path: Path, injector: cr.Injector, random: np.random.Generator) -> None:
    """Write the map as a spreadsheet in German keeps it: text, decimal commas, masses per stroke."""
    from openpyxl import Workbook

    points = [
        cr.OperatingPoint(1e5 * p, 1e-6 * t, CYLINDER, RETURN, horizon=1e-6 * t + 4e-3)
        for p in MAP_RAIL
        for t in MAP_TIME
    ]
    mass = 1e6 * cr.simulate_batch(injector, points, time_step=FINE, threads=1).injected_mass[0]
    mass = np.maximum(
        mass * (1.0 + MAP_NOISE * random.standard_normal(mass.shape)) + random.normal(0, 0.03, len(mass)), 0
    )
    book = Workbook()
    sheet = book.active
    sheet.append(["synthetisch: simuliert, nicht gemessen"])
    sheet.append(["Einspritzmenge [mg/Hub]"])
    sheet.append(["Raildruck [bar] \\ Ansteuerdauer [us]", *map(str, MAP_TIME)])
    for p, row in zip(MAP_RAIL, mass.reshape(len(MAP_RAIL), -1), strict=True):
        sheet.append([str(p), *(f"{value:.3f}".replace(".", ",") for value in row)])
    book.save(path)


def write_record(path: Path, injector: cr.Injector, random: np.random.Generator) -> None:
    """Write the record of 120 shots, seven channels on four rasters."""
    from asammdf import MDF, Signal

    order = random.permutation(np.repeat(np.arange(len(SHOT_POINTS)), EACH))
    length = SPACING * len(order)
    time = {name: np.arange(0.0, length, step) for name, step in RASTERS.items()}
    flow, trigger = random.normal(0.0, RATE_NOISE, len(time["rate"])), np.zeros(len(time["rate"]))
    shapes, starts = [metered_rate(injector, *point) for point in SHOT_POINTS], SPACING * (np.arange(len(order)) + 0.2)
    current, pressure = np.zeros(len(time["current"])), np.zeros(len(time["pressure"]))
    for start, k in zip(starts, order, strict=True):
        first = round(start / RASTERS["rate"])
        flow[first : first + len(shapes[k])] += shapes[k] * (1.0 + SCATTER * random.standard_normal())
        trigger[first : first + 100] = 5.0
        rail, energised = SHOT_POINTS[k]
        on = (time["current"] >= start + EARLY) & (time["current"] < start + EARLY + 1e-6 * energised)
        current[on] = 12.0  # a plot for the eye: no study reads it
        pressure[(time["pressure"] >= start - 2e-3) & (time["pressure"] < start + 8e-3)] = rail
    record, points = MDF(), np.array(SHOT_POINTS, float)[order]
    fast = [Signal(flow, time["rate"], "mm³/ms", "ROI"), Signal(trigger, time["rate"], "V", "TRIG")]
    for group in (
        fast,
        [Signal(current, time["current"], "A", "I_inj")],
        [Signal(pressure, time["pressure"], "bar", "pRail")],
        [
            Signal(points[:, k], starts - 1e-3, unit, name)
            for k, unit, name in ((0, "bar", "p_set"), (1, "us", "ti_set"))
        ]
        + [Signal(np.full(len(order), 40.0), starts - 1e-3, "degC", "T_fuel")],
    ):
        record.append(group)
    record.save(path, overwrite=True, compression=2)
    record.close()


def write_bench(folder: Path, seed: int, wrong: float) -> None:
    """Write files and truth of a bench, and the study as `commonrail new` and its user write it."""
    folder.mkdir(parents=True)
    truth, random = true_values(seed), np.random.default_rng([seed, 2])
    injector = cr.load_injector(INJECTOR).with_values(truth)
    write_map(folder / "map.xlsx", injector, random)
    write_record(folder / "record.mf4", injector, random)
    free = [f"--free={name}" for name in SPREAD]
    sources = [f"--from={folder / name}" for name in ("map.xlsx", "record.mf4")]
    bench = [f"--cylinder-pressure={CYLINDER}", f"--return-pressure={RETURN}", f"--injector={INJECTOR}"]
    command(["new", str(folder / "fit"), *bench, *sources, *free])
    write_study(folder / "fit" / "study.toml", truth, wrong)
    (folder / "truth.json").write_text(
        json.dumps(truth | {"meter.tube.delay": DELAY + HALF_SAMPLE}, indent=1), encoding="utf-8"
    )


def write_study(path: Path, truth: dict[str, float], wrong: float) -> None:
    """Write what only the user knows into the study: the trigger, the meter, the measured lift."""
    text = path.read_text(encoding="utf-8")
    text = re.sub(r'offset = "\?"[^,}]*', f'offset = "{1e6 * EARLY:g} us"', text)
    text = re.sub(r'(?m)^(name = "record.*")$', r'\1\nmeter = "tube"', text)
    text = re.sub(r'(?m)^synthetic = "".*$', 'synthetic = "studies/walk_bench.py"', text)
    stated = f"""[meters.tube]
law = "cascade"
order = 2
cutoff = "{1e-3 * POLE:g} kHz"
delay = {{ lower = "0 us", upper = "40 us", start = "10 us" }}
source = "step response of the tube"
mark = "M"

[[fixed]]
name = "{LIFT}"
value = "{1e6 * truth[LIFT] * (1.0 + wrong):.3f} um"
mark = "M"
source = "measured on the part"

"""
    if wrong:
        volts = cr.load_injector(INJECTOR).values["drive.quench_voltage"] * (1.0 - wrong)
        stated += (
            f'[[fixed]]\nname = "drive.quench_voltage"\nvalue = "{volts:.3f} V"\nmark = "E"\nsource = "guessed"\n\n'
        )
    head, first, rest = text.partition("[[data]]")
    path.write_text(head + stated + first + rest, encoding="utf-8")


def command(words: list[str]) -> None:
    """Run a command of commonrail as a user does."""
    done = subprocess.run([sys.executable, "-m", "commonrail", *words], capture_output=True, text=True, check=False)
    if done.returncode not in (0, 2):  # 2: `new` lists what the study must state
        raise SystemExit(done.stderr)


def fit_bench(bench: Path) -> None:
    """Calibrate; if verdicts are not confirmed search from more starts, as the report then advises."""
    run = bench / "run"
    command(["calibrate", str(bench / "fit" / "study.toml"), "--no-live", "--threads", "1", "--out", str(run)])
    record = json.loads((run / "result.json").read_text(encoding="utf-8"))
    if record["certainty"]["withdrawn"]:
        command(["certainty", str(run), "--threads", "1"])


def fits(folder: Path) -> Iterator[tuple[dict[str, float], dict[str, Any]]]:
    """Truths and results of the benches of a folder."""
    for path in sorted(folder.glob("*/run/result.json")):
        truth = json.loads((path.parents[1] / "truth.json").read_text(encoding="utf-8"))
        yield truth, json.loads(path.read_text(encoding="utf-8"))


def print_table(folder: Path) -> None:
    """Print shares of truths inside the stated intervals and of verdicts, and why parameters are not determined."""
    from commonrail.report.fit.verdict import verdict

    titles: dict[str, int] = {}
    reasons: dict[str, int] = {}
    inside = determined = wrong = intervals = benches = 0
    for truth, record in fits(folder):
        benches += 1
        reason = record["certainty"]["withdrawn"].split(":")[0] or "confirmed"
        reasons[reason] = reasons.get(reason, 0) + 1
        title = verdict(record, "run").title
        titles[title] = titles.get(title, 0) + 1
        for parameter in record["certainty"]["parameters"]:
            low, high = parameter["lower"], parameter["upper"]
            if low is None or high is None:
                continue
            intervals += 1
            holds = low <= truth[parameter["name"]] <= high
            inside += holds
            determined += parameter["verdict"] == "determined"
            wrong += parameter["verdict"] == "determined" and not holds
    print(f"{benches} benches; truths inside their intervals: {inside} of {intervals}")
    print(f"determined: {determined}; of these the interval misses the truth: {wrong}")
    for title, count in [*sorted(titles.items()), *sorted(reasons.items())]:
        print(f"{count:4d}  {title}")


def main() -> None:
    """Files of one bench, or fits of many."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("files", "seeds", "table"))
    parser.add_argument("folder", type=Path, metavar="DIR")
    parser.add_argument("--seed", type=int, default=1, help="the first one")
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--wrong", type=float, default=0.0, metavar="SHARE")
    args = parser.parse_args()
    if args.what == "files":
        write_bench(args.folder, args.seed, args.wrong)
    elif args.what == "seeds":
        for seed in range(args.seed, args.seed + args.count):
            bench = args.folder / f"{seed:03d}"
            if not bench.exists():
                write_bench(bench, seed, args.wrong)
            if not (bench / "run" / "result.json").exists():
                fit_bench(bench)
    if args.what != "files":
        print_table(args.folder)


if __name__ == "__main__":
    main()
