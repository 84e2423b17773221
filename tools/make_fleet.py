"""Make a synthetic fleet: injectors whose parameters scatter, simulated and given noise, ready for commonrail fleet.

    python -m tools.make_fleet /somewhere/fleet --injectors 200
    commonrail fleet /somewhere/fleet/fleet.toml --out runs/fleet

Two layouts: "files", one file for each injection curve, and "rows", one table with the quantities of all injectors. The
curves come from the same model and time step that the fit uses, so a fit can meet them to the noise: the fleet measures
the work, not the model. All files are synthetic and say so.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.plan import reference_density
from commonrail.engine.simulate import sampled_rates, simulate_batch
from commonrail.engine.time_step import DEFAULT_STEP
from commonrail.physics.injector import Injector, parameter_quantities
from commonrail.readers.injector import load_injector

Floats = NDArray[np.float64]

INJECTOR = "virtual-lino-2016"
SYNTHETIC = "simulated by commonrail with scattered parameters and noise, not measured"

# Standard deviations from part to part, as shares: made up for the example, not measured.
SCATTER = {
    "control_chamber.z_hole_diameter": 0.01,
    "control_chamber.a_hole_diameter": 0.01,
    "nozzle.discharge_maximum": 0.01,
    "valve.spring_preload": 0.03,
}
WIDEST = 2.5  # standard deviations at which the scatter is cut off; the bounds lie at 4

PRESSURES = {"160 MPa": "fit", "80 MPa": "validation"}  # of the curves
ENERGISING, SAMPLES, INTERVAL = 700e-6, 520, 3e-6  # of a curve
RATE_NOISE = 0.3e-6  # standard deviation of a sample [m³/s]

MAP_PRESSURES, MAP_TIMES = (80e6, 120e6, 160e6), (300e-6, 500e-6, 700e-6, 1000e-6)
QUANTITY_NOISE = 0.01  # relative standard deviation of a quantity

BLOCK = 64  # injectors that are simulated at a time

STUDY = """# SYNTHETIC: {synthetic}
# Template of a fleet: the fleet's table says which files stand in place of those below.
format = "commonrail-study/1"
title = "Synthetic fleet"
injector = "{injector}"

{data}
{parameters}
[optimiser]
members = {members}
generations = {generations}
"""
DATA = """[[data]]
kind = "{kind}"
name = "{name}"
role = "{role}"
file = "see the fleet's table"
{own}cylinder_pressure = "5 MPa"
return_pressure = "0.5 MPa"
source = "tools/make_fleet.py"
synthetic = "The {what} are {synthetic}."
"""
CURVE = 'rail_pressure = "{name}"\nenergising_time = "700 us"\n'
PARAMETER = """
[[parameter]]
name = "{name}"
below = "{percent:g} %"
above = "{percent:g} %"
"""
FLEET = """# SYNTHETIC: {synthetic}
format = "commonrail-fleet/1"
title = "Synthetic fleet of {count} injectors"
study = "study.toml"
{key} = "{table}"
seed = 1
"""


def draw_true_values(injector: Injector, count: int, rng: np.random.Generator) -> Floats:
    """True values of each injector (count, parameters), SI."""
    nominal = np.array([injector.values[name] for name in SCATTER])
    deviations = np.clip(rng.standard_normal((count, len(nominal))), -WIDEST, WIDEST)
    return np.asarray(nominal * (1.0 + deviations * np.array(list(SCATTER.values()))))


def curves(injector: Injector, values: Floats, pressure: float, rng: np.random.Generator) -> Floats:
    """Injection curves with noise (injectors, samples) [m³/s]."""
    point = OperatingPoint(pressure, ENERGISING, horizon=SAMPLES * INTERVAL)
    bounds = np.array([INTERVAL * i for i in range(SAMPLES + 1)])
    parts = [values[i : i + BLOCK] for i in range(0, len(values), BLOCK)]
    mass = np.concatenate(
        [sampled_rates(injector, point, bounds, list(SCATTER), member, DEFAULT_STEP) for member in parts]
    )
    return np.asarray(mass / reference_density(injector, point) + RATE_NOISE * rng.standard_normal(mass.shape))


def maps(injector: Injector, values: Floats, rng: np.random.Generator) -> Floats:
    """Quantities with noise (injectors, points) [m³]."""
    points = [OperatingPoint(pressure, time) for pressure in MAP_PRESSURES for time in MAP_TIMES]
    quantity = simulate_batch(injector, points, list(SCATTER), values).injected_volume
    return np.asarray(quantity * (1.0 + QUANTITY_NOISE * rng.standard_normal(quantity.shape)))


def write_table(path: Path, header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Write a CSV, or a Parquet file where its name ends so."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".parquet":
        import pyarrow
        from pyarrow import parquet

        columns = dict(zip(header, map(list, zip(*rows, strict=True)), strict=True))
        typed = {name: list(map(float, cells)) if "[" in name else cells for name, cells in columns.items()}
        parquet.write_table(pyarrow.table(typed).replace_schema_metadata({"SYNTHETIC": SYNTHETIC}), path)
        return
    with path.open("w", encoding="utf-8", newline="") as stream:
        stream.write(f"# SYNTHETIC: {SYNTHETIC}\n")
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)


def write_curves(folder: Path, table: str, injector: Injector, values: Floats, rng: np.random.Generator) -> None:
    """A file for each curve, and the table that names them."""
    names = serial_numbers(len(values))
    for text in PRESSURES:
        pressure = 1e6 * float(text.partition(" ")[0])
        for name, rate in zip(names, curves(injector, values, pressure, rng), strict=True):
            cells = [(f"{3 * (i + 1)}", f"{value * 1e6:.6g}") for i, value in enumerate(rate)]
            write_table(folder / "data" / f"{name}_{text.replace(' ', '')}.csv", ["time [us]", "rate [mm3/ms]"], cells)
    rows = [[name, *(f"data/{name}_{text.replace(' ', '')}.csv" for text in PRESSURES)] for name in names]
    write_table(folder / table, ["injector", *PRESSURES], rows)


def write_map(folder: Path, table: str, injector: Injector, values: Floats, rng: np.random.Generator) -> None:
    """One table with the quantities of all."""
    points = [(pressure, time) for pressure in MAP_PRESSURES for time in MAP_TIMES]
    rows = [
        [name, f"{pressure * 1e-6:g}", f"{time * 1e6:g}", f"{quantity * 1e9:.6g}"]
        for name, quantities in zip(serial_numbers(len(values)), maps(injector, values, rng), strict=True)
        for (pressure, time), quantity in zip(points, quantities, strict=True)
    ]
    header = ["injector", "rail_pressure [MPa]", "energising_time [us]", "quantity [mm3]"]
    write_table(folder / table, header, rows)


def serial_numbers(count: int) -> list[str]:
    """Serial numbers."""
    return [f"SN{i:06d}" for i in range(1, count + 1)]


def make_fleet(folder: Path, count: int, layout: str = "files", table: str = "", **search: int) -> Path:
    """Write a fleet of so many injectors; returns its file.

    `layout` is "files" or "rows", `table` the name of its table; one that ends in .parquet is Parquet. `search` are
    `members` and `generations` of each search, and `seed` of scatter and noise.
    """
    injector, rng = load_injector(INJECTOR), np.random.default_rng(search.get("seed", 1))
    values = draw_true_values(injector, count, rng)
    files = layout == "files"
    table = table or ("injectors.csv" if files else "measurements.csv")
    (write_curves if files else write_map)(folder, table, injector, values, rng)
    units = parameter_quantities()
    heads = [f"{name} [{units[name].unit}]" for name in SCATTER]
    rows = [[name, *map(repr, row)] for name, row in zip(serial_numbers(count), values.tolist(), strict=True)]
    write_table(folder / "truth.csv", ["injector", *heads], rows)
    curve, maps = {"kind": "rate", "what": "injection curves"}, {"kind": "quantities", "what": "quantities"}
    sets = [{"name": name, "role": role, "own": CURVE.format(name=name)} | curve for name, role in PRESSURES.items()]
    if not files:
        sets = [{"name": "map", "role": "fit", "own": ""} | maps]
    study = STUDY.format(
        synthetic=SYNTHETIC,
        injector=INJECTOR,
        data="\n".join(DATA.format(synthetic=SYNTHETIC, **data_set) for data_set in sets),
        parameters="".join(PARAMETER.format(name=name, percent=400.0 * share) for name, share in SCATTER.items()),
        members=search.get("members", 30),
        generations=search.get("generations", 40),
    )
    (folder / "study.toml").write_text(study, encoding="utf-8")
    path = folder / "fleet.toml"
    key = "files" if files else "rows"
    path.write_text(FLEET.format(synthetic=SYNTHETIC, count=count, key=key, table=table), encoding="utf-8")
    return path


def main() -> None:
    """Read the command line and write the fleet."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--injectors", type=int, default=200)
    parser.add_argument("--layout", choices=("files", "rows"), default="files")
    parser.add_argument("--table", default="", help="name of the table; .parquet for Parquet")
    parser.add_argument("--members", type=int, default=30)
    parser.add_argument("--generations", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    search = {key: getattr(args, key) for key in ("members", "generations", "seed")}
    print(make_fleet(args.folder, args.injectors, args.layout, args.table, **search))


if __name__ == "__main__":
    main()
