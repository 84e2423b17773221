"""Judges the verdicts: do the titles of calibrations tell right from wrong? All data are SYNTHETIC.

    python -m studies.judge_trial foreign DIR            # three injectors that no model of commonrail made
    python -m studies.judge_trial studies DIR -n 130     # right studies, and such that are wrong in one law or constant
    python -m studies.judge_trial table DIR              # tables of what is there

`foreign` takes the way of a new user: `commonrail new`, `calibrate`, then up to four of the steps that the verdict
advises, as they are printed. Each step has a row: errors of what was fitted and of quantities that
were not, the title, what an engineer says by the limits alone (good up to 3 %, usable up to 10 %, of the fitted
quantities above 3 mm³ and of each curve), and the same errors of two trivial models: the start values times one gain,
and the map interpolated between its points.

`studies` fits benches of `studies/wrong_studies.py` as `calibrate` does, and counts titles. Harmful is a wrong study of
which a value is off by more than three of its stated standard errors, or a quantity at unseen points by more than 3 %.
"""

from __future__ import annotations

import argparse
import json
import re
import shlex
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

import commonrail as cr
from studies.foreign_benches import FOREIGN, MAP_RAIL, MAP_TIME, write_bench
from studies.wrong_studies import STEP, UNSEEN, draw_bench, quantities

Floats = NDArray[np.float64]
Record = dict[str, Any]

SEED = 4711
LARGE = 3.0  # quantity above which an error counts in percent [mm³]
GOOD, USABLE = 3.0, 10.0  # limits of an engineer [%]
STEPS, STARTS = 4, 32  # followed after the first fit; of a search that is still run, minutes
ERRORS, PERCENT = 3.0, 3.0  # stated standard errors, and error of an unseen quantity, from which a study is harmful
LEVELS = ("good", "care", "bad")
MM3 = 1e9  # of 1 m³


def verdict_of(record: Record, run: str) -> tuple[str, str, list[str], list[tuple[str, str]]]:
    """Level, title, reasons and steps (text, command) of a result."""
    from commonrail.calibration.record import CalibrationRecord, read_as
    from commonrail.report.fit.verdict import verdict

    judged = verdict(read_as(CalibrationRecord, record), run)
    return judged.level, judged.title, list(judged.reasons), [(step.text, step.command) for step in judged.steps]


# Foreign benches.


def command(words: Sequence[str], folder: Path) -> None:
    """Run a command of commonrail in a folder as a user does."""
    line = [sys.executable, "-m", "commonrail", *words]
    done = subprocess.run(line, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{' '.join(words)}: exit status {done.returncode}\n{done.stderr[-2000:]}")


def judge_foreign(name: str, folder: Path) -> Iterator[Record]:
    """Rows of the fits of a foreign bench, in the order of a user's steps."""
    bench, place = FOREIGN[name], folder / name
    files, unseen = write_bench(bench, place / "files", SEED)
    sources = [word for file in files for word in ("--from", str(file))]
    pressures = ["--cylinder-pressure", "5MPa", "--return-pressure", "0.1MPa"]
    command(["new", "study", "--injector", str(place / "files" / "injector.toml"), *sources, *pressures], place)
    study, line = place / "study" / "study.toml", ["calibrate"]
    done: set[str] = set()
    for number in range(STEPS + 1):
        run = place / f"run{number}"
        if line[0] == "calibrate":
            command([*(line if number else ["calibrate", str(study)]), "--out", str(run), "--no-live", *ONE], place)
        else:  # the command changes its run folder: it gets a copy, so that each row stays to be read
            shutil.copytree(place / f"run{number - 1}", run)
            command([str(run) if word == str(place / f"run{number - 1}") else word for word in line] + ONE, place)
        record = json.loads((run / "result.json").read_text(encoding="utf-8"))
        row, steps = row_of(name, " ".join(line), record, run, unseen)
        yield row
        line = next((words for _, text in steps if (words := followed(text, done))), [])
        if not line:
            return


ONE = ["--threads", "1"]


def followed(text: str, done: set[str]) -> list[str]:
    """Words of an advised command behind "commonrail" that is followed and was not before, else none."""
    words = shlex.split(text)[1:]
    kind = re.sub(r"\S*/", "", " ".join(words))
    many = re.search(r"--starts (\d+)", text)
    changes = {"--widen", "--free"} & set(words) if words[:1] == ["calibrate"] else words[:1]
    fits = words[:1] and words[0] in ("calibrate", "certainty", "resume") and changes
    if not fits or int(many[1] if many else 0) > STARTS or kind in done:
        return []
    done.add(kind)
    return words


def row_of(
    name: str, step: str, record: Record, run: Path, unseen: Mapping[tuple[int, int], float]
) -> tuple[Record, list[tuple[str, str]]]:
    """Row of a fit, and the steps that its verdict advises."""
    level, title, reasons, steps = verdict_of(record, str(run))
    maps = next(d for d in record["data"] if d["kind"] == "quantities")
    curves = {d["name"]: 100.0 * (d["J_relative"]["best"] or np.nan) for d in record["data"] if d["kind"] == "rate"}
    points = tuple((1e5 * rail, 1e-6 * time) for rail, time in unseen)
    measured = np.array(list(unseen.values()))
    study = cr.load_study(run / "study.toml")
    start, step_time = study.injector, study.time_step  # stiff values bear a short step alone
    fitted = cr.load_injector(str(run / "calibrated.toml"))
    error = percent_rms(measured, MM3 * quantities(fitted, points, step_time))
    table = np.array([row["measured"] for row in maps["rows"]]) * MM3
    start_map = np.array([row["start"] for row in maps["rows"]], float) * MM3
    gain = float(table @ start_map / (start_map @ start_map))
    grid = RegularGridInterpolator((MAP_RAIL, MAP_TIME), table.reshape(len(MAP_RAIL), len(MAP_TIME)))
    of_map = maps["figures"]["best"]["rms_large_percent"]
    return {
        "bench": name,
        "step": re.sub(r"\S*/", "", step),
        "map": of_map,
        "curves": curves,
        "unseen": error,
        "level": level,
        "title": title,
        "engineer": engineer([of_map, *curves.values()]),
        "reasons": reasons,
        "steps": steps,
        "warnings": [w["code"] for w in record["warnings"]],
        "scaled": {
            "map": percent_rms(table, gain * start_map),
            "unseen": percent_rms(measured, gain * MM3 * quantities(start, points, step_time)),
        },
        "interpolated": {"unseen": percent_rms(measured, grid(np.array(list(unseen), float)))},
    }, steps


def percent_rms(measured: Floats, values: Floats) -> float:
    """Root mean square error of large quantities [%]."""
    large = measured > LARGE
    return float(100.0 * np.sqrt(np.mean((values[large] / measured[large] - 1.0) ** 2)))


def engineer(errors: Sequence[float]) -> str:
    """Level by the limits alone."""
    worst = max(errors)
    return LEVELS[0] if worst <= GOOD else LEVELS[1] if worst <= USABLE else LEVELS[2]


# Right and wrong studies.


def judge_study(seed: int, folder: Path) -> Record:
    """Row of a right or wrong study; a run folder that is complete is judged again, not fitted again."""
    bench, run = draw_bench(seed), folder / f"study{seed}"
    if not (run / "result.json").is_file():
        shutil.rmtree(run, ignore_errors=True)
        cr.runs.calibrate_into(run, bench.study, threads=1)
    record = json.loads((run / "result.json").read_text(encoding="utf-8"))
    level, title, reasons, _ = verdict_of(record, "run")
    injector = cr.load_injector(str(run / "calibrated.toml"))
    apart = quantities(injector, UNSEEN, STEP) / bench.unseen - 1.0
    certainty = record["certainty"]
    off = {
        p["name"]: abs(p["value"] - bench.truth[p["name"]]) / p["standard_error"]
        for p in certainty["parameters"]
        if p["standard_error"]
    }
    fit = {
        d["name"]: 100.0 * d["J_relative"]["best"] if d["kind"] == "rate" else d["figures"]["best"]["rms_large_percent"]
        for d in record["data"]
    }
    return {
        "seed": seed,
        "injector": bench.study.injector.name,
        "data": [d["name"] for d in record["data"]],
        "wrong": bench.wrong,
        "noise": bench.noise,
        "level": level,
        "title": title,
        "reasons": reasons,
        "withdrawn": certainty["withdrawn"],
        "tests": [{key: t.get(key) for key in ("name", "suspect", "score", "found")} for t in certainty["tests"]],
        "verdicts": [p["verdict"] for p in certainty["parameters"]],
        "fit": fit,
        "errors": max(off.values(), default=None),
        "unseen": float(100.0 * np.abs(apart).max()),
    }


def is_harmful(row: Record) -> bool:
    """True if values or predictions are worse than they are said to be."""
    return (row["errors"] or 0.0) > ERRORS or row["unseen"] > PERCENT


def is_named(row: Record) -> bool:
    """True if a statistical test found something, and the title is not the best one."""
    return bool(row["level"] != LEVELS[0] and any(test["found"] for test in row["tests"]))


# Tables.


def foreign_table(rows: Sequence[Record]) -> str:
    """One line for each fit of a foreign bench."""
    lines = [
        "| bench | step | map, % | curves, % | unseen, % | scaled start: map, unseen, % | interpolated, % | title "
        "| engineer |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for r in rows:
        curves = " ".join(f"{value:.1f}" for value in r["curves"].values())
        scaled = f"{r['scaled']['map']:.1f} {r['scaled']['unseen']:.1f}"
        lines.append(
            f"| {r['bench']} | {r['step']} | {r['map']:.1f} | {curves} | {r['unseen']:.1f} | {scaled} | "
            f"{r['interpolated']['unseen']:.1f} | {r['title']} | {r['engineer']} |"
        )
    return "\n".join(lines)


def studies_table(rows: Sequence[Record]) -> str:
    """Titles of right and wrong studies, then one line for each kind of wrong."""
    groups = {
        "right": [r for r in rows if not r["wrong"]],
        "wrong": [r for r in rows if r["wrong"]],
        "wrong and harmful": [r for r in rows if r["wrong"] and is_harmful(r)],
    }
    groups |= {f"right, {noise}": [r for r in groups["right"] if r["noise"] == noise] for noise in _all(rows, "noise")}
    groups |= {name: [r for r in rows if r["wrong"] == name] for name in _all(groups["wrong"], "wrong")}
    lines = [
        "| studies | number | good | care | bad | named by a test | largest error of a value, stated SE: median, worst "
        "| of unseen quantities, %: median, worst |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, group in groups.items():
        if not group:
            continue
        count = Counter(r["level"] for r in group)
        errors, unseen = np.array([r["errors"] or 0.0 for r in group]), np.array([r["unseen"] for r in group])
        lines.append(
            f"| {name} | {len(group)} | {' | '.join(str(count[level]) for level in LEVELS)} | "
            f"{sum(is_named(r) for r in group)} | {np.median(errors):.1f} {errors.max():.1f} | "
            f"{np.median(unseen):.2f} {unseen.max():.2f} |"
        )
    return "\n".join(lines)


def _all(rows: Sequence[Record], key: str) -> list[str]:
    return sorted({row[key] for row in rows})


def read_rows(path: Path) -> list[Record]:
    """Rows of a file, none if there is no file."""
    rows: list[Record] = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else []
    return rows


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one part, or print its tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", choices=("foreign", "studies", "table"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("-n", type=int, default=130, help="studies [default: 130]")
    parser.add_argument("--bench", action="append", choices=list(FOREIGN), help="foreign benches [default: all]")
    own = parser.parse_args(arguments)
    own.folder.mkdir(parents=True, exist_ok=True)
    paths = {part: own.folder / f"{part}.json" for part in ("foreign", "studies")}
    rows: list[Record] = []
    for row in _run(own.part, own.folder, own.n, own.bench or list(FOREIGN)):
        rows.append(row)
        paths[own.part].write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    if found := read_rows(paths["foreign"]):
        print(foreign_table(found))
    if found := read_rows(paths["studies"]):
        print(studies_table(found))
    return 0


def _run(part: str, folder: Path, many: int, benches: Sequence[str]) -> Iterator[Record]:
    if part == "foreign":
        for name in benches:
            shutil.rmtree(folder / name, ignore_errors=True)
            yield from judge_foreign(name, folder)
    elif part == "studies":
        for seed in range(many):
            yield judge_study(seed, folder)


if __name__ == "__main__":
    raise SystemExit(main())
