"""Instructions of a step of the fast engine, the processor's bound for them and the distance from it.

``python -m benchmarks.roofline [RECORD.json]`` prints a table, and adds it to a benchmark's record. The machine code
is that of the kernel as built here; its bound is what ``llvm-mca`` finds for the ports of the processor if every value
were there in time (reciprocal throughput), left out where there is no llvm-mca. Since that is a model, the bound is
measured, too: the same instructions in the same order with the same places in memory, but each with operands that are
always there. Cycles are measured: a chain of dependent instructions of one cycle each tells the clock.
"""

from __future__ import annotations

import ctypes
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite.binding as llvm
import numba
import numpy as np

from benchmarks.case import POINT, TIME_STEP, candidates, injector
from benchmarks.timing import Effort, time_best
from commonrail.base.choices import Precision
from commonrail.compiler.child import texts
from commonrail.compiler.lower import optimise, schedule_instructions
from commonrail.compiler.target import System, own_processor
from commonrail.engine import lanes, plan
from commonrail.engine.job import VECTORS
from commonrail.engine.machine_code import source_of, symbol_of
from commonrail.engine.plan import candidate_matrix
from commonrail.plugins.paper import study

CHAIN_LATENCY = 6  # cycles of three dependent shifts and exclusive ors
KINDS = {
    "multiply, add": r"v(f[n]?m(add|sub)\d+|mul|add|sub)p[sd]",
    "divisions": r"v(div|rcp14|rcp)p[sd]",
    "roots": r"v(sqrt|rsqrt14|rsqrt)p[sd]",
    "compare, select, min, max": r"v(cmp\w*|min|max|blend\w*|and\w*|or|xor)p[sd]",
    "loads": r"LOAD",
    "stores": r"STORE",
}


def step_block(assembly: str) -> list[str]:
    """Instructions of the step: the straight pieces with most of the vector arithmetic, one after the other."""
    blocks: list[list[str]] = [[]]
    for line in assembly.splitlines():
        text = line.split("#")[0].strip()
        if re.match(r"\S+:", text) or re.match(r"(j\w+|ret\w*|call\w*)\b", text):
            blocks.append([])
        elif text and not text.startswith("."):
            blocks[-1].append(text)
    arithmetic = re.compile(r"v(f|mul|add|sub|div|sqrt)\w*p[sd]\s.*[yz]mm")
    return [line for block in blocks if sum(bool(arithmetic.match(line)) for line in block) >= 40 for line in block]


def counts(block: list[str]) -> dict[str, int]:
    """Vector instructions of a step by kind; loads and stores are counted wherever an operand lies in memory."""
    tally = dict.fromkeys(KINDS, 0)
    for line in block:
        operation, _, operands = line.partition("\t")
        operation, operands = (operation, operands) if operands else (line.split()[0], line)
        for kind, pattern in KINDS.items():
            tally[kind] += bool(re.fullmatch(pattern, operation)) and bool(re.search(r"[xyz]mm", line))
        if "(" in operands:
            tally["stores" if operation.startswith("vmov") and operands.rstrip().endswith(")") else "loads"] += 1
    tally["on the stack"] = sum("(%rsp)" in line for line in block)
    return tally


def port_bound(block: list[str]) -> float | None:
    """Cycles of a step if only the processor's ports bound it, as llvm-mca has them; None without llvm-mca."""
    tool = shutil.which("llvm-mca")
    if tool is None:
        return None
    command = [tool, "-mtriple=x86_64", "-mcpu=native", "-iterations=10", "-all-stats=false"]
    done = subprocess.run(command, input="\n".join(block), capture_output=True, text=True, check=False)
    return reciprocal_throughput(done.stdout)


def reciprocal_throughput(report: str) -> float | None:
    """Cycles of a block of instructions according to a report of llvm-mca; None if it states none."""
    match = re.search(r"Block RThroughput:\s*([0-9.]+)", report)
    return float(match.group(1)) if match else None


def without_waiting(block: list[str]) -> list[str]:
    """The vector instructions of a step, none of which waits for another.

    Results go to registers in turn that nothing reads; memory is read and written where the step does, by cache lines.
    """
    free, lines = 0, []
    for line in block:
        operation, _, operands = line.replace("\t", " ").partition(" ")
        if not re.search(r"%[yz]mm", operands):
            continue
        operands = re.sub(r"([.\w]*)\((%\w+)[^)]*\)", _in_line, operands)
        *sources, result = re.split(r",\s*(?![^(]*\))", operands.strip())
        operands_always_ready = [re.sub(r"mm\d+", f"mm{31 - i % 2}", source) for i, source in enumerate(sources)]
        if "mm" in result:
            result = re.sub(r"mm\d+", f"mm{free % 28}", result)
            free += 1
        lines.append(f"{operation} {', '.join([*operands_always_ready, result])}")
    return lines


def _in_line(place: re.Match[str]) -> str:
    offset = int(place[1]) if place[1].isdigit() else 0  # a constant has a name in place of an offset
    return f"{offset & ~63 or ''}({'%rdx' if place[2] == '%rsp' else '%rsi'})"


def repeat_block(block: list[str]) -> str:
    """LLVM module with a function ``march(count, read, written)`` that repeats a step without waiting `count` times."""
    ones = [f"vbroadcastsd (%rsi), %zmm{register}" for register in (30, 31)]
    lines = ["march:", *ones, "1:", *without_waiting(block), "dec %rdi", "jnz 1b", "vzeroupper", "ret"]
    return "\n".join(f'module asm "{line}"' for line in [".globl march", *lines])


def measured_bound(block: list[str]) -> float | None:
    """Seconds of a step none of whose instructions waits for another; None without registers of 512 bits."""
    if not llvm.get_host_cpu_features().get("avx512vl", False):
        return None
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    llvm.initialize_native_asmparser()
    machine = llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(), features=llvm.get_host_cpu_features().flatten(), jit=True
    )
    try:
        engine = llvm.create_mcjit_compiler(llvm.parse_assembly(repeat_block(block)), machine)
        engine.finalize_object()
        address = engine.get_function_address("march")
    except RuntimeError:
        return None
    if not address:
        return None
    march = ctypes.CFUNCTYPE(None, ctypes.c_long, ctypes.c_void_p, ctypes.c_void_p)(address)
    memory = np.ones(1 << 15)
    start = (memory.ctypes.data + 4095) & ~4095
    count = 100_000
    return _best(lambda: march(count, start, start + memory.nbytes // 2), 9) / count


@numba.njit  # type: ignore[untyped-decorator]
def _chain(count: int, x: int) -> int:
    for _ in range(count):
        x ^= x << 13
        x ^= x >> 7
        x ^= x << 17
    return x


def clock() -> float:
    """Cycles a second of the core that this runs on."""
    _chain(10, 1)
    count = 20_000_000
    return count * CHAIN_LATENCY / _best(lambda: _chain(count, 3), 9)


def _best(action: Callable[[], Any], runs: int) -> float:
    return time_best(action, Effort(runs, float("inf"))).seconds


class Times(NamedTuple):
    """Measurements of a step: seconds of the run, of a step without waiting (None: not measured), clock [Hz]."""

    run: float
    without_waiting: float | None
    clock: float


def figures(block: list[str], steps: int, times: Times, bound: float | None) -> dict[str, Any]:
    """What a step is made of, its bounds, and the cycles that it takes.

    `block` are the instructions of the step, `steps` those of the run, of one block of lanes each; `bound` is the
    number of cycles of a step according to llvm-mca.
    """
    cycles = times.run * times.clock / steps
    least = None if times.without_waiting is None else times.without_waiting * times.clock
    return {
        "instructions": len(block),
        **counts(block),
        "cycles_a_step": cycles,
        "bound_cycles": bound,
        "share_of_bound": None if bound is None else bound / cycles,
        "cycles_without_waiting": least,
        "share_of_measured_bound": None if least is None else least / cycles,
        "gigahertz": times.clock / 1e9,
    }


def measure(precision: Precision) -> dict[str, Any]:
    """The step of one precision, measured on this machine."""
    variant = injector().variant
    vector = VECTORS[precision]
    values = candidates(8 * vector.lanes)
    steps = round(POINT.duration / TIME_STEP)
    theta = candidate_matrix(injector(), study.NAMES, values)
    job = plan.make_job(plan.prepare(injector(), [POINT], TIME_STEP), theta, False, vector.lanes)
    lanes.run(job, variant, precision=precision)
    seconds = _best(lambda: lanes.run(job, variant, precision=precision), 30)
    hertz = clock()
    names = {"lanes": symbol_of(variant, vector.precision)}
    machine, code = optimise(texts(source_of(variant, vector, False)), names, System.of(own_processor()))
    block = step_block(str(machine.emit_assembly(schedule_instructions(machine, code))))
    times = Times(seconds, measured_bound(block), hertz)
    return {
        "precision": precision.value,
        "lanes": vector.lanes,
        **figures(block, 8 * steps, times, port_bound(block)),
        "simulations_per_second_and_core": len(values) / seconds,
    }


def main() -> None:
    """Measure, print, and add the figures to a record if one is named."""
    rows = [measure(precision) for precision in Precision]
    for key in rows[0]:
        texts = [f"{row[key]:.4g}" if isinstance(row[key], float) else str(row[key]) for row in rows]
        print(f"{key:34s}", *(f"{text:>14s}" for text in texts))
    for name in sys.argv[1:]:
        record = json.loads(Path(name).read_text(encoding="utf-8"))
        record["roofline"] = rows
        Path(name).write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
