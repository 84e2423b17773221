"""Simulations for the pages, in a separate process: the server stays small, and no page waits for a compiler.

``python -m commonrail.plugins.app.preview`` reads requests and writes answers, a line of JSON each.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import sqlite3
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from commonrail.base.child import python, same_modules
from commonrail.base.errors import CommonrailError, InputError
from commonrail.base.input import read_plain

MOST_SAMPLES = 400  # of a curve that is drawn
LONGEST_LINE = 20_000_000  # of an answer [bytes]
# Parameters listed next to the section drawing, by group.
GROUPS = {
    "solenoid": "solenoid.turns solenoid.resistance solenoid.residual_gap drive.peak_current drive.hold_current",
    "armature and valve": "valve.lift valve.mass valve.spring_preload valve.seat_diameter",
    "A-hole": "control_chamber.a_hole_diameter control_chamber.a_hole_discharge",
    "Z-hole": "control_chamber.z_hole_diameter control_chamber.z_hole_discharge",
    "control chamber": "control_chamber.volume",
    "plunger": "plunger_needle.plunger_diameter plunger_needle.plunger_gap",
    "needle": "plunger_needle.stop_lift plunger_needle.guide_diameter plunger_needle.spring_preload",
    "accumulation volume": "accumulation.volume",
    "seat": "needle_seat.diameter needle_seat.cone_angle",
    "SAC": "sac.volume",
    "nozzle holes": "nozzle.holes nozzle.hole_diameter nozzle.discharge_maximum",
    "drive, rail and pipes": "drive.boost_voltage drive.peak_duration rail.volume feed_pipe.length feed_pipe.diameter",
}


class Preview:
    """The process, started when it is first asked."""

    def __init__(self) -> None:
        self._process: asyncio.subprocess.Process | None = None
        self._lock = asyncio.Lock()

    async def ask(self, folder: Path, **request: Any) -> dict[str, Any]:
        """Answer to a request; `InputError` if it cannot be answered."""
        async with self._lock:
            if self._process is None or self._process.returncode is not None:
                self._process = await asyncio.create_subprocess_exec(
                    *python("-m", "commonrail.plugins.app.preview"),
                    cwd=folder,
                    env=same_modules(),
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.DEVNULL,
                    limit=LONGEST_LINE,
                )
            stdin, stdout = self._process.stdin, self._process.stdout
            assert stdin is not None
            assert stdout is not None
            try:
                stdin.write(json.dumps(request).encode() + b"\n")
                await stdin.drain()
                line = await stdout.readline()
            except (ConnectionError, ValueError):
                line = b""
            if not line:
                self.close()
                raise InputError("The simulation ended without an answer; try again.")
            answer: dict[str, Any] = json.loads(line)
            if "error" in answer:
                raise InputError(answer["error"])
            return answer

    def close(self) -> None:
        """End the process."""
        if self._process is not None and self._process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                self._process.kill()
        self._process = None


def _thin_out(values: Any, count: int = MOST_SAMPLES) -> list[float | None]:
    """Means of neighbours that reduce a curve to at most `count` values; None for a missing one."""
    values = np.asarray(values, dtype=float)
    width = -(-len(values) // count)
    parts = [values[i : i + width].mean() for i in range(0, len(values), width)]
    return [float(f"{value:.5g}") if np.isfinite(value) else None for value in parts]


def _compare(data: Any, simulated: Any) -> dict[str, Any]:
    """Measured and simulated values of a data set, as they are drawn, and the mean error."""
    measured, judged = data.measured, data.judged & np.isfinite(simulated)
    error = float(np.abs(simulated - measured)[judged].sum() / max(np.abs(measured)[judged].sum(), 1e-300))
    answer: dict[str, Any] = {"name": data.name, "kind": data.kind, "role": data.role.value, "error": error}
    answer["failed"] = int((data.judged & ~np.isfinite(simulated)).sum())
    if data.kind == "rate":
        middle = 0.5e6 * (data.bounds[1:] + data.bounds[:-1])
        return answer | {
            "time": _thin_out(middle),
            "measured": _thin_out(measured * 1e6),
            "simulated": _thin_out(simulated * 1e6),
        }
    rows = []
    if len(data.points) == len(measured) and "quantities" in data.kind:
        for point, is_judged, value, model in zip(data.points, data.judged, measured, simulated, strict=True):
            if is_judged:
                duration = sum(pulse.duration for pulse in point.pulses)
                row = [point.initial_pressures()[0] * 1e-6, duration * 1e6, value * 1e9, model * 1e9]
                rows.append([float(f"{x:.5g}") if np.isfinite(x) else None for x in row])
        rms = float(np.sqrt(np.mean((simulated - measured)[judged] ** 2))) if judged.any() else 0.0
        answer["rms"] = rms * 1e9
    return answer | {"rows": rows}


class Worker:
    """Answers to requests; the last study stays in memory."""

    def __init__(self) -> None:
        self._key: Any = None
        self._study: Any = None

    def _load(self, path: Path) -> Any:
        from commonrail.calibration.study_file import load_study

        files = [path, path.parent / "injector.toml", *sorted((path.parent / "data").glob("*"))]
        key = [(file, file.stat().st_mtime_ns) for file in files if file.is_file()]
        if key != self._key:
            self._study, self._key = load_study(path), key
        return self._study

    def study(self, path: str, values: dict[str, float], shifts: dict[str, float]) -> dict[str, Any]:
        """Data of a study, simulated at its start values; `values` [SI] replace these, `shifts` [s] move time zeros."""
        from commonrail.data.simulator import Simulator

        study = self._load(Path(path))
        names = [p.name for p in study.space.parameters]
        start = np.array([[values.get(p.name, p.reference) for p in study.space.parameters]])
        simulator, sets, meters = Simulator(study.injector, names, study.time_step), [], {}
        for data in study.data:
            if (meter := data.meter) is not None:
                name = f"meter.{meter.name}.delay"
                delay = dict(zip(names, start[0], strict=True)).get(name, meter.values.get("delay", 0.0))
                meters[meter.name] = float(values.get(name, delay))
                if name not in names and name in values:
                    data = data.changed(meter=_with_delay(meter, values[name]))
            if data.name in shifts and data.bounds is not None:
                data = data.changed(bounds=data.bounds - shifts[data.name])
            sets.append(_compare(data, data.simulated(simulator, start)[0]))
        return {"data": sets, "meters": meters}

    def parameters(self, path: str) -> dict[str, Any]:
        """Free parameters of a study [SI], and all parameters that could be freed."""
        from commonrail.base.units import to_text
        from commonrail.physics.injector import parameter_quantities

        study, quantities = self._load(Path(path)), parameter_quantities()
        rows = []
        for p in study.space.parameters:
            usual = quantities[p.name].usual if p.name in quantities else None
            low, high = usual or (2.0 * p.lower - p.upper, 2.0 * p.upper - p.lower)
            width = p.upper - p.lower
            low, high = min(p.lower, max(low, p.lower - width)), max(p.upper, min(high, p.upper + width))
            rows.append({"name": p.name, "unit": p.unit, "lower": p.lower, "upper": p.upper, "start": p.reference})
            rows[-1] |= {
                "least": low,
                "most": high,
                "meaning": quantities[p.name].meaning if p.name in quantities else "delay of the meter",
            }
        texts = {n: [to_text(x, q.unit, 4) for x in q.usual] for n, q in quantities.items() if q.usual}
        return {"rows": rows, "usual": texts, "meaning": {n: q.meaning for n, q in quantities.items()}}

    def section(self, injector: str) -> dict[str, Any]:
        """Section of an injector, and its dimensions with marks."""
        from commonrail.base.units import to_text
        from commonrail.engine.operating_point import OperatingPoint
        from commonrail.engine.simulate import simulate
        from commonrail.physics.injector import parameter_quantities
        from commonrail.plugins.features.anatomy import still_section
        from commonrail.readers.injector import load_injector

        model, quantities = load_injector(injector), parameter_quantities()
        groups = []
        for words, names in GROUPS.items():
            rows = []
            for name in names.split():
                if name in model.values:
                    source = model.sources.get(name)
                    row = {
                        "name": name,
                        "meaning": quantities[name].meaning,
                        "text": to_text(model.values[name], quantities[name].unit),
                    }
                    rows.append(row | {"mark": source.mark if source else "E", "source": source.text if source else ""})
            groups += [[words, rows]] if rows else []
        picture = ""
        with contextlib.suppress(CommonrailError):
            solution = simulate(model, OperatingPoint(rail_pressure=1e8, energisings=8e-4))
            picture = str(still_section(solution))
        return {"title": model.title, "groups": groups, "picture": picture}

    def runs(self, place: str) -> dict[str, Any]:
        """State of all runs."""
        from commonrail.runs.listing import list_runs

        keys = ("state", "title", "reason", "generation", "generations", "refinements", "best", "age", "seconds")
        rows = [{k: getattr(run, k) for k in keys} | {"name": run.folder.name} for run in list_runs(Path(place))]
        return {"runs": [{k: v if v == v and v != float("inf") else None for k, v in run.items()} for run in rows]}

    def run(self, place: str) -> dict[str, Any]:
        """Course of a run, its best values so far and its start values, and its process."""
        folder = Path(place)
        course: list[float] = []
        best = process = None
        with contextlib.closing(sqlite3.connect(f"{(folder / 'journal.sqlite').as_uri()}?mode=ro", uri=True)) as file:
            for table in ("generation", "refinement"):
                for value, trials, costs in file.execute(f"SELECT best, trials, costs FROM {table} ORDER BY number"):
                    if not course or value < min(course):
                        numbers = np.nan_to_num(np.frombuffer(costs, "<f8"), nan=np.inf)
                        best = np.frombuffer(trials, "<f8").reshape(len(numbers), -1)[int(np.argmin(numbers))]
                    course.append(float(value))
            for number, ended in file.execute("SELECT process, ended FROM session ORDER BY number"):
                process = None if ended else int(number)
        names = [p.name for p in self._load(folder / "study.toml").space.parameters]
        record = {}
        if (folder / "result.json").is_file():
            record = json.loads(read_plain(folder / "result.json"))
        values = {p["name"]: p["best"] for p in record.get("parameters", ())}
        if not values and best is not None:
            values = dict(zip(names, map(float, best), strict=True))
        before, after = (self.study(str(folder / "study.toml"), v, {})["data"] for v in ({}, values))
        return {"course": course, "process": process, "before": before, "after": after}


def _with_delay(meter: Any, delay: float) -> Any:
    from dataclasses import replace

    return replace(meter, values={**meter.values, "delay": delay})


def main() -> None:
    """Answer requests until stdin ends."""
    answers, sys.stdout = sys.stdout, sys.stderr
    worker = Worker()
    for line in sys.stdin:
        request = json.loads(line)
        try:
            answer = getattr(worker, request.pop("do"))(**request)
        except CommonrailError as error:
            answer = {"error": str(error)}
        except sqlite3.Error as error:
            answer = {"error": f"The journal cannot be read now ({error})."}
        answers.write(json.dumps(answer, allow_nan=False) + "\n")
        answers.flush()


if __name__ == "__main__":
    main()
