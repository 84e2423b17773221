"""Time and accuracy of one simulation, of a population and of a calibration, with peers, in one run.

``python -m benchmarks.run [--json FILE]``. Every method solves the same equations; its L1 error of the rate and
its volume error against a tight reference stand beside its time. Nothing here passes or fails.
"""

from __future__ import annotations

import argparse
import json
import platform
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.optimize import differential_evolution

from benchmarks.peers import scipy_solution, sundials_solution
from commonrail.calibration.objective import Objective
from commonrail.calibration.run import calibrate
from commonrail.calibration.study import Method, Study
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.reference import Resolution, simulate_reference
from commonrail.engine.simulate import simulate, simulate_batch, usable_threads
from commonrail.engine.solution import Solution
from commonrail.files.injector_file import load_injector
from commonrail.files.truth_file import load_truth
from commonrail.reproduction import paper
from commonrail.reproduction.repetition import Bench, measure

POINT = OperatingPoint(160e6, 700e-6, horizon=1.56e-3)
INTERVAL = 3e-6


def best_time(action: Callable[[], Any], repeats: int) -> float:
    """Shortest wall time of several runs [s]."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        action()
        times.append(time.perf_counter() - start)
    return min(times)


def errors(solution: Solution, truth: Solution) -> dict[str, float]:
    """L1 error of the rate and error of the volume, both in percent."""
    level = float(np.sum(np.abs(truth.mass_rate)))
    return {
        "L1_percent": 100.0 * float(np.sum(np.abs(solution.mass_rate - truth.mass_rate))) / level,
        "volume_percent": 100.0 * (solution.injected_mass / truth.injected_mass - 1.0),
    }


def one_simulation() -> list[dict[str, Any]]:
    """One simulation: reference, peers, lanes."""
    injector = load_injector("virtual-lino-2016")
    truth = simulate_reference(injector, POINT, INTERVAL, Resolution((480, 240), 1e-9))
    rows = []

    def add(name: str, run: Callable[[], Solution], repeats: int = 1) -> None:
        solution = run()  # compiles, and gives the accuracy
        rows.append({"method": name, "seconds": best_time(run, repeats), **errors(solution, truth)})

    add("SciPy LSODA, rtol 1e-8, 240 cells", lambda: simulate_reference(injector, POINT, INTERVAL))
    coarse = Resolution((120, 60), 1e-5)
    add("SciPy LSODA, rtol 1e-5, 120 cells", lambda: simulate_reference(injector, POINT, INTERVAL, coarse))
    for method in ("RK45", "DOP853"):
        add(f"SciPy {method}, rtol 1e-5, 120 cells", lambda m=method: scipy_solution(injector, POINT, INTERVAL, m))  # type: ignore[misc]
    try:
        import sksundae  # noqa: F401
    except ImportError:
        pass
    else:
        add("SUNDIALS CVODE, rtol 1e-5, 120 cells", lambda: sundials_solution(injector, POINT, INTERVAL))
    for step in (1e-6, 0.5e-6):
        add(
            f"commonrail lanes, {step * 1e6:g} us, alone in its block",
            lambda dt=step: simulate(injector, POINT, time_step=dt, sample_interval=INTERVAL),  # type: ignore[misc]
            5,
        )
    return rows


def population() -> list[dict[str, Any]]:
    """512 candidates at one point."""
    injector = load_injector("virtual-lino-2016")
    names = list(paper.NAMES)
    rng = np.random.default_rng(1)
    centre = np.array([injector.values[n] for n in names])
    rows = []
    for count, threads in ((512, 1), (512, usable_threads()), (50, usable_threads()), (4096, usable_threads())):
        values = centre * rng.uniform(0.8, 1.2, (count, len(names)))

        def run(v: np.ndarray = values, t: int = threads) -> Any:
            return simulate_batch(injector, [POINT], names, v, threads=t, stop_when_closed=False)

        run()
        seconds = best_time(run, 9)
        rows.append({"candidates": count, "threads": threads, "seconds": seconds, "per_second": count / seconds})
    return rows


def paper_study() -> Study:
    """The paper's problem: seven stiffnesses, (70, 50), one pressure, on virtual data."""
    bench = Bench(load_truth("virtual-lino-2016"), load_injector("virtual-lino-2016"), 1e-6)
    data = measure(bench, 1)[:1]
    return Study("paper", bench.injector, data, paper.space(bench.injector), Method(paper.BEST.settings), 1, 1e-6)


def calibrations() -> list[dict[str, Any]]:
    """50 x 70 calibration, ours and SciPy's differential evolution on the same objective."""
    study = paper_study()
    calibrate(study)
    result = calibrate(study)
    rows = [
        {
            "method": "commonrail DE 50 x 70",
            "seconds": result.seconds,
            "J": result.cost,
            "simulations": result.simulations,
        }
    ]
    objective = Objective(study.injector, study.space.names, study.data, study.time_step)
    count = 0

    def cost(x: np.ndarray) -> np.ndarray:
        nonlocal count
        count += x.shape[1]
        return objective.costs(x.T).costs

    start = time.perf_counter()
    found = differential_evolution(
        cost,
        list(zip(study.space.lower, study.space.upper, strict=True)),
        strategy="rand1bin",
        maxiter=70,
        popsize=8,
        mutation=(0.4, 1.0),
        recombination=0.8,
        tol=0.0,
        polish=False,
        vectorized=True,
        updating="deferred",
        rng=1,
        init="random",
    )
    rows.append(
        {
            "method": "SciPy DE, 56 x 70, bounds only (no ordering)",
            "seconds": time.perf_counter() - start,
            "J": float(found.fun),
            "simulations": count,
        }
    )
    return rows


def command_line() -> dict[str, float]:
    """Start-up of the command line [s]."""
    command = [sys.executable, "-m", "commonrail.cli.app", "--help"]
    return {"commonrail --help": best_time(lambda: subprocess.run(command, check=True, capture_output=True), 7)}


def show(title: str, rows: list[dict[str, Any]], console: Console) -> None:
    """Print rows as a table."""
    table = Table(title=title)
    for key in rows[0]:
        table.add_column(key, justify="left" if key == "method" else "right")
    for row in rows:
        table.add_row(*(value if isinstance(value, str) else f"{value:,.6g}" for value in row.values()))
    console.print(table)


def main() -> None:
    """Run everything, print tables, write JSON if asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, help="also write the figures to this file")
    arguments = parser.parse_args()
    console = Console(width=120)
    machine = {"processor": platform.processor() or platform.machine(), "threads": usable_threads()}
    console.print(f"{machine}; the first run of each compiles and is not counted")
    figures: dict[str, Any] = {"machine": machine}
    for name, run in (("one simulation", one_simulation), ("population", population), ("calibration", calibrations)):
        figures[name] = run()
        show(name, figures[name], console)
    figures["start-up"] = command_line()
    console.print(figures["start-up"])
    if arguments.json:
        arguments.json.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
