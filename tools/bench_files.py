"""Make four data files of a test bench in the forms in which benches give them. All of them are SYNTHETIC.

    python -m tools.bench_files DIR

    map_january.csv   quantity map as a matrix, as a German spreadsheet saves it: semicolons, decimal commas, cp1252
    rates.csv         twelve injection rates in columns, named 500bar_300us and so on
    shots.mf4         MDF4 record of 100 shots at 4 operating points, found by a trigger 35 us before energising
    map_march.xlsx    quantity map as a matrix the other way round, by mass, in a workbook

The data are those of the virtual injector virtual-lino-2016 with three values changed, simulated by commonrail itself,
with Gaussian noise. They show how files are read, not how well a model describes an injector.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import commonrail as cr

Floats = NDArray[np.float64]

INJECTOR = "virtual-lino-2016"
TRUTH = {
    "control_chamber.z_hole_diameter": "0.211 mm",
    "control_chamber.a_hole_diameter": "0.266 mm",
    "nozzle.discharge_maximum": 0.80,
}
CYLINDER, RETURN = "5 MPa", "0.5 MPa"
SEED = 1

MAP_RAIL, MAP_TIME = (400, 800, 1200, 1600), (300, 400, 600, 800, 1000)  # bar, us
RATE_RAIL, RATE_TIME = (500, 900, 1300, 1700), (300, 500, 800)
SHOT_POINTS = ((600, 350), (600, 700), (1400, 350), (1400, 700))
SHOTS, SPACING, AHEAD = 100, 10e-3, 35e-6  # number, time between [s], trigger before energising [s]
INTERVAL = 10e-6  # of the samples [s]
QUANTITY_NOISE, RATE_NOISE, SHOT_SCATTER = 0.1, 0.3, 0.01  # mm³, mm³/ms, relative, from shot to shot


def true_injector() -> cr.Injector:
    """The injector whose data the files hold."""
    return cr.load_injector(INJECTOR).with_values(TRUTH)


def quantities(injector: cr.Injector, rail: tuple[int, ...], time: tuple[int, ...]) -> Floats:
    """Injected volumes (rail pressures, times) [mm³]."""
    points = [
        cr.OperatingPoint(1e5 * p, 1e-6 * t, CYLINDER, RETURN, horizon=1e-6 * t + 3e-3) for p in rail for t in time
    ]
    volumes: Floats = 1e9 * cr.simulate_batch(injector, points, threads=1).injected_volume[0]
    return volumes.reshape(len(rail), len(time))


def rate(injector: cr.Injector, rail: int, time: int) -> Floats:
    """Mean rates [mm³/ms] over the intervals that end at 10 us, 20 us … 3 ms from the start of energising."""
    solution = cr.simulate(injector, cr.OperatingPoint(1e5 * rail, 1e-6 * time, CYLINDER, RETURN, horizon=3e-3))
    moments = np.arange(0.0, 3e-3 + 0.5 * INTERVAL, INTERVAL)
    volume = 1e9 * solution.injected / solution.reference_density  # [mm³] at the bounds of the samples
    return np.diff(np.interp(moments, solution.time, volume)) / (1e3 * INTERVAL)


def write_german_map(path: Path, quantity: Floats) -> None:
    """Write a matrix, rail pressures down, as a German spreadsheet saves it."""
    lines = ["Synthetisch: simuliert, nicht gemessen", "Einspritzmenge [mm³]"]
    lines += ["Raildruck [bar] \\ Ansteuerdauer [µs];" + ";".join(map(str, MAP_TIME))]
    for p, row in zip(MAP_RAIL, quantity, strict=True):
        lines.append(f"{p};" + ";".join(f"{value:.2f}".replace(".", ",") for value in row))
    path.write_bytes(("\r\n".join(lines) + "\r\n").encode("cp1252"))


def write_wide_rates(path: Path, injector: cr.Injector, random: np.random.Generator) -> None:
    """Write twelve rates, one column each."""
    names = [f"{p}bar_{t}us" for p in RATE_RAIL for t in RATE_TIME]
    rates = np.column_stack([rate(injector, p, t) for p in RATE_RAIL for t in RATE_TIME])
    rates += random.normal(0.0, RATE_NOISE, rates.shape)
    lines = ["# SYNTHETIC: simulated, not measured", ",".join(["time [us]", *(f"{n} [mm3/ms]" for n in names)])]
    for i, row in enumerate(rates):
        lines.append(",".join([f"{(i + 1) * INTERVAL * 1e6:g}", *(f"{value:.4f}" for value in row)]))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_shots(path: Path, injector: cr.Injector, random: np.random.Generator) -> None:
    """Write a record of all shots with their trigger and set points."""
    from asammdf import MDF, Signal

    time = INTERVAL * np.arange(1, round(SHOTS * SPACING / INTERVAL) + 1)
    flow, trigger = random.normal(0.0, RATE_NOISE, len(time)), np.zeros(len(time))
    shapes = {point: rate(injector, *point) for point in SHOT_POINTS}
    starts = SPACING * (np.arange(SHOTS) + 0.2)
    for i, start in enumerate(starts):
        p, t = SHOT_POINTS[i % len(SHOT_POINTS)]
        first = round(start / INTERVAL)
        flow[first : first + 300] += shapes[p, t] * (1.0 + random.normal(0.0, SHOT_SCATTER))
        trigger[(time >= start - AHEAD) & (time < start + 1e-6 * t)] = 5.0
    set_points = np.array([SHOT_POINTS[i % len(SHOT_POINTS)] for i in range(SHOTS)], float)
    record = MDF()
    record.append([Signal(flow, time, "mm³/ms", "ROI"), Signal(trigger, time, "V", "TRIG")], acq_name="fast")
    slow = [
        Signal(set_points[:, k], starts - 5e-3, unit, name)
        for k, unit, name in ((0, "bar", "pRail_set"), (1, "us", "ti_set"))
    ]
    record.append(slow, acq_name="slow")
    record.save(path, overwrite=True, compression=2)
    record.close()


def write_workbook(path: Path, quantity: Floats, density: float) -> None:
    """Write a matrix of masses [mg], rail pressures [MPa] across, in a workbook."""
    from openpyxl import Workbook

    book = Workbook()
    sheet = book.active
    sheet.title = "map"
    sheet.append(["SYNTHETIC: simulated, not measured"])
    sheet.append(["injected mass [mg]"])
    sheet.append(["energising time [us] \\ rail pressure [MPa]", *(p / 10 for p in MAP_RAIL)])
    for t, row in zip(MAP_TIME, quantity.T, strict=True):
        sheet.append([t, *(round(float(value) * density * 1e-3, 3) for value in row)])
    book.save(path)


def write_bench_files(folder: Path) -> list[Path]:
    """Write the four files; returns their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    random = np.random.default_rng(SEED)
    injector = true_injector()
    true = quantities(injector, MAP_RAIL, MAP_TIME)
    density = cr.simulate(injector, cr.OperatingPoint("40 MPa", "300 us", CYLINDER, RETURN)).reference_density
    paths = [folder / name for name in ("map_january.csv", "rates.csv", "shots.mf4", "map_march.xlsx")]
    write_german_map(paths[0], np.maximum(true + random.normal(0.0, QUANTITY_NOISE, true.shape), 0.0))
    write_wide_rates(paths[1], injector, random)
    write_shots(paths[2], injector, random)
    write_workbook(paths[3], np.maximum(true + random.normal(0.0, QUANTITY_NOISE, true.shape), 0.0), density)
    return paths


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="DIR")
    for written in write_bench_files(parser.parse_args().folder):
        print(written)
