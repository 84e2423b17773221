"""Trial of compensated energising times: truths of the reference engine, in a closed loop with the virtual sensor.

Parts, sensor, pump and neighbours are those of `studies.observer_trial`. Each part injects trains of pilot and main at
two rail pressures over the dwell, in random order: first with energising times that deliver each quantity by itself by
the catalogue's model ("none"), then with those of the model for each dwell ("map"), which is the first round of the
closed loop; after each round the observer takes its log, and the next round has the times that its states give,
from the second log on half of the way from those before.

    python -m studies.compensation_trial --injectors 8 --rounds 3 --seed 13
    python -m studies.compensation_trial --injectors 3 --rounds 3 --seed 13 --pilots 2
"""

from __future__ import annotations

import argparse
import time
from itertools import product
from typing import Any

import numpy as np

import commonrail as cr
from studies.observer_trial import (
    CYLINDER,
    DELAY,
    GAIN,
    MODEL,
    NOISE,
    OFFSET,
    RETURN,
    draw_part,
    log_of,
    true_shot,
)

PILOT, MAIN = 2.4e-9, 24e-9  # [m³]: 2 and 20 mg
RAILS = (70e6, 140e6)
DWELLS = np.array([0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.2, 1.4, 1.7, 2.0]) * 1e-3  # from end to start of energisings [s]


class Part:
    """One part with its sensor; `shots` injects trains and returns their quantities and the log."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.injector, self.friction = draw_part(rng)
        gain, offset = GAIN * rng.standard_normal(), OFFSET * rng.standard_normal()
        self.errors = (rng.uniform(-DELAY, DELAY), gain, offset, rng.uniform(*NOISE))

    def shown(self, rail: float) -> float:
        """What the sensor shows of a rail pressure [Pa]."""
        return rail * (1.0 + self.errors[1]) + self.errors[2]

    def inject(self, cells: list[Any], trains: list[list[tuple[float, float]]]) -> tuple[np.ndarray, Any] | None:
        """Quantities (trains, injections) [m³] and log of trains at cells (rail, dwell); None if one fails."""
        order = self.rng.permutation(len(cells))
        shots = [true_shot(self.injector, self.friction, cells[i][0], trains[i]) for i in order]
        if not all(shots):
            return None
        quantities = np.array([shot["figures"][0] for shot in shots if shot])[np.argsort(order)]
        return quantities, log_of([shot for shot in shots if shot], self.rng, "rail", "apart", self.errors)


def closed_loop(
    specimen: Part, cells: list[Any], volumes: tuple[float, ...], rounds: int
) -> tuple[list[np.ndarray], int] | None:
    """Quantities (trains, injections) [m³] without, with a map, and after each round; alarms. None if a shot fails."""
    model = cr.load_injector(MODEL)
    settings = cr.observer.ObserverSettings(cylinder_pressure=CYLINDER, return_pressure=RETURN)
    trains = [
        cr.observer.InjectionTrain(specimen.shown(rail), volumes, (dwell,) * (len(volumes) - 1))
        for rail, dwell in cells
    ]
    times = cr.observer.compensate(model, trains, settings, threads=1)
    without = [train_times._replace(energising_times=train_times.plain_times) for train_times in times]
    quantities, previous, last, alarms = [], None, None, 0
    for k, used in enumerate([without, *[times] * (rounds + 1)]):
        if previous is not None:
            used = last = cr.observer.compensate(previous, trains, last=last, threads=1)
        done = specimen.inject(cells, [[(a, b) for a, b in train_times.energisings] for train_times in used])
        if done is None:
            return None
        quantities.append(done[0])
        if 0 < k <= rounds:
            clock, pressure, pulses = done[1]
            first = settings if previous is None else None
            previous = cr.observer.observe(model, clock, pressure, pulses, first, previous=previous, threads=1)
            alarms += sum(shot.alarm is not None for shot in previous.shots)
    return quantities, alarms


def report(table: np.ndarray, volumes: np.ndarray) -> None:
    """Print spreads and biases; `table` (injectors, rounds, rails, dwells, injections) [mm³]."""
    per_round = len(RAILS) * len(DWELLS)
    names = ["none", "map", *(f"after {per_round * k} shots" for k in range(1, table.shape[1] - 1))]
    for i, volume in enumerate(volumes):
        print(f"injection {i + 1}, {volume:g} mm3; over the injectors (root mean square, largest)")
        for j, rail in enumerate(RAILS):
            rows = table[:, :, j, :, i]
            spread, width, bias = rows.std(axis=2), np.ptp(rows, axis=2), rows.mean(axis=2) - volume
            rms, error = (
                np.sqrt(np.mean(x**2, axis=0))
                for x in (spread, rows.transpose(0, 2, 1).reshape(-1, rows.shape[1]) - volume)
            )
            for k, name in enumerate(names):
                times = f"; sd {rms[0] / rms[k]:.1f} x less than none, {rms[1] / rms[k]:.1f} x than map"
                print(
                    f"  {rail * 1e-6:4.0f} MPa {name:16s} sd over dwell {rms[k]:6.3f}, {spread[:, k].max():6.3f}; "
                    f"max-min {np.sqrt(np.mean(width[:, k] ** 2)):6.3f}, {width[:, k].max():6.3f}; bias "
                    f"{np.sqrt(np.mean(bias[:, k] ** 2)):6.3f}; error {error[k]:6.3f} mm3"
                    + times
                    * bool(rms[0] > 0.01 * volume)
                )


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--injectors", type=int, default=8)
    parser.add_argument("--rounds", type=int, default=3, help="logs that the observer takes")
    parser.add_argument("--seed", type=int, default=13)
    parser.add_argument("--pilots", type=int, default=1)
    args = parser.parse_args()
    volumes, cells = (PILOT,) * args.pilots + (MAIN,), list(product(RAILS, DWELLS.tolist()))
    rows, begin, failed = list[np.ndarray](), time.perf_counter(), 0
    shape = args.rounds + 2, len(RAILS), len(DWELLS), len(volumes)
    try:
        while len(rows) < args.injectors:
            k = len(rows) + failed
            done = closed_loop(Part(np.random.default_rng([args.seed, k])), cells, volumes, args.rounds)
            if done is None:  # a part that does not work at some point would not pass the end of its line
                failed += 1
                continue
            rows.append(np.array(done[0]).reshape(shape) * 1e9)
            print(f"{len(rows)}/{args.injectors}: {done[1]} alarms, {time.perf_counter() - begin:.0f} s", flush=True)
    finally:  # also after an interruption
        if rows:
            report(np.array(rows), np.array(volumes) * 1e9)
        print(f"{len(rows)} injectors; {failed} more with a shot that failed were left out")


if __name__ == "__main__":
    main()
