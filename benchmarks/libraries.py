"""Loops of the libraries compared with the compiler's: ``python -m benchmarks.libraries [ROUNDS]``.

Two processes, one of which may not use the libraries, simulate the same 512 candidates in turn: whatever else
the machine does disturbs both; the shortest times count. Before them a simulation is started from the command line,
several times either way.
"""

from __future__ import annotations

import hashlib
import json
import os
import statistics
import subprocess
import sys
import time
from dataclasses import fields
from typing import Any

from benchmarks.case import POINT, candidates, injector
from benchmarks.timing import Effort, time_best
from commonrail.base.choices import Precision
from commonrail.compiler.target import SWITCH
from commonrail.engine import machine_code, plan
from commonrail.engine.lanes import load_loop
from commonrail.engine.simulate import simulate_batch
from commonrail.engine.solution import Batch
from commonrail.plugins.paper import study

COUNT, ROUNDS, STARTS = 512, 30, 10
KINDS = ("library", "compiler")
SIMULATE = ("simulate", "virtual-lino-2016", "--rail-pressure", "160MPa", "--energising-time", "700us")


def environment(kind: str) -> dict[str, str]:
    """Environment of a process that may or may not use the libraries."""
    paths = os.pathsep.join(path for path in sys.path if path)
    switch = {} if kind == "library" else {SWITCH: "off"}
    return os.environ | {"PYTHONPATH": paths, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"} | switch


def start(kind: str) -> tuple[float, float, float]:
    """Wall time [s], processor time [s] and greatest memory [MB] of a simulation from the command line."""
    before, begun = os.times(), time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-m", "commonrail", *SIMULATE], env=environment(kind), stdout=subprocess.DEVNULL
    )
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    wall, after = time.perf_counter() - begun, os.times()
    if process.returncode:
        sys.exit(f"the simulation ended with status {process.returncode}")
    spent = after.children_user + after.children_system - before.children_user - before.children_system
    return wall, spent, usage.ru_maxrss / 1024


def serve() -> None:
    """Answer every line of the input, which names a precision, with the time and digest of a population."""
    values, prepared = candidates(COUNT), plan.prepare(injector(), [POINT], 1e-6)
    for line in sys.stdin:
        precision = Precision(line.strip())
        batches: list[Batch] = []

        def run(precision: Precision = precision, batches: list[Batch] = batches) -> None:
            batches[:] = [
                simulate_batch(
                    injector(),
                    [POINT],
                    study.NAMES,
                    values,
                    threads=1,
                    stop_when_closed=False,
                    precision=precision,
                    prepared=prepared,
                )
            ]

        timing = time_best(run, Effort(1, 1.0))
        batch, origin = batches[0], load_loop(injector().variant, precision, False).origin
        digest = hashlib.sha256(b"".join(getattr(batch, field.name).tobytes() for field in fields(batch))).hexdigest()
        print(json.dumps({"seconds": timing.seconds, "digest": digest, "origin": origin}), flush=True)


def main(rounds: int = ROUNDS) -> None:
    """Print both tables; ends with a sentence where no library is used."""
    if machine_code.objection():
        sys.exit(f"no library is used: {machine_code.objection()}; `make kernels` builds those of the catalogue")
    print("| simulation from the command line | wall, s | processor, s | memory, MB |")
    print("| --- | --- | --- | --- |")
    for kind in KINDS:
        start(kind)
        medians = [statistics.median(column) for column in zip(*(start(kind) for _ in range(STARTS)), strict=True)]
        print(f"| {kind} | {medians[0]:.2f} | {medians[1]:.2f} | {medians[2]:.0f} |", flush=True)
    print("| precision, 512 candidates on one thread | library, per second | compiled, per second | ratio | bits |")
    print("| --- | --- | --- | --- | --- |")
    servers = {kind: _server(kind) for kind in KINDS}
    for precision in Precision:
        asked: dict[str, list[dict[str, Any]]] = {kind: [] for kind in KINDS}
        for _ in range(rounds + 1):
            for kind, server in servers.items():
                asked[kind].append(_ask(server, precision))
        if asked["library"][0]["origin"] != "library":
            sys.exit(f"the libraries do not hold the loop of {injector().name} in {precision.value}")
        shortest = [min(answer["seconds"] for answer in asked[kind][1:]) for kind in KINDS]  # the first one may compile
        same = {answer["digest"] for answers in asked.values() for answer in answers}
        speeds = [COUNT / seconds for seconds in shortest]
        bits = "equal" if len(same) == 1 else "different"
        print(
            f"| {precision.value} | {speeds[0]:,.0f} | {speeds[1]:,.0f} | {speeds[0] / speeds[1]:.3f} | {bits} |",
            flush=True,
        )
    for server in servers.values():
        server.communicate()


def _server(kind: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "benchmarks.libraries", "--serve"]
    return subprocess.Popen(command, env=environment(kind), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def _ask(server: subprocess.Popen[str], precision: Precision) -> dict[str, Any]:
    assert server.stdin is not None
    assert server.stdout is not None
    server.stdin.write(f"{precision.value}\n")
    server.stdin.flush()
    answer: dict[str, Any] = json.loads(server.stdout.readline())
    return answer


if __name__ == "__main__":
    if sys.argv[1:] == ["--serve"]:
        serve()
    else:
        main(*map(int, sys.argv[1:]))
