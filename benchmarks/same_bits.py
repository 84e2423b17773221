"""Speed of `same_bits` compared with this machine's own code: ``python -m benchmarks.same_bits [ROUNDS]``.

Both simulate the same 512 candidates in turn: whatever else the machine does disturbs both. The shortest times
count; processor time does not see waiting.
"""

from __future__ import annotations

import functools
import sys

from benchmarks.case import POINT, TIME_STEP, candidates, injector
from benchmarks.timing import Effort, Timing, time_best
from commonrail.base.choices import Precision
from commonrail.engine import plan
from commonrail.engine.simulate import simulate_batch
from commonrail.engine.threads import usable_threads
from commonrail.plugins.paper import study

COUNT, ROUNDS = 512, 30


def main(rounds: int = ROUNDS) -> None:
    """Print candidates per second of wall time and of processor time, and their ratios."""
    prepared, values = plan.prepare(injector(), [POINT], TIME_STEP), candidates(COUNT)
    print("| precision | threads | own, per second | same bits | ratio | ratio of processor times |")
    print("| --- | --- | --- | --- | --- | --- |")
    for precision in Precision:
        for threads in sorted({1, usable_threads()}):

            def run(same_bits: bool, precision: Precision = precision, threads: int = threads) -> None:
                simulate_batch(
                    injector(),
                    [POINT],
                    study.NAMES,
                    values,
                    time_step=TIME_STEP,
                    threads=threads,
                    stop_when_closed=False,
                    precision=precision,
                    prepared=prepared,
                    same_bits=same_bits,
                )

            timings_of_mode: dict[bool, list[Timing]] = {False: [], True: []}
            for _ in range(rounds + 1):
                for same, timings in timings_of_mode.items():
                    timings.append(time_best(functools.partial(run, same), Effort(1, 1.0)))
            default, exact = (timings_of_mode[same][1:] for same in (False, True))  # the first one compiles
            wall = [min(t.seconds for t in timings) for timings in (default, exact)]
            processor = [min(t.cpu_seconds for t in timings) for timings in (default, exact)]
            print(
                f"| {precision.value} | {threads} | {COUNT / wall[0]:,.0f} | {COUNT / wall[1]:,.0f} "
                f"| {wall[0] / wall[1]:.2f} | {processor[0] / processor[1]:.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
