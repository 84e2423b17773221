"""The run folder: what a calibration leaves behind."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping
from itertools import dropwhile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from commonrail.calibration.result import result_record
from commonrail.calibration.run import Calibration
from commonrail.calibration.score import RateScore
from commonrail.calibration.study import RateData
from commonrail.errors import InputError
from commonrail.files.injector_file import dump_injector

Floats = NDArray[np.float64]

_COLUMNS = ("measured", "rigid", "start", "best")


def create_run_folder(path: Path) -> Path:
    """Make a new run folder.

    Raises
    ------
    InputError
        If it exists and is not empty, or cannot be made.
    """
    if path.exists() and (not path.is_dir() or any(path.iterdir())):
        raise InputError(
            f"{path}: there already is something; name another folder with --out, nothing was overwritten."
        )
    try:
        path.mkdir(parents=True, exist_ok=True)
        probe = path / ".writable"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise InputError(
            f"{path}: the run folder cannot be written ({error.strerror}); name another one with --out."
        ) from error
    return path


def write_run(folder: Path, calibration: Calibration, identified: Mapping[str, Mapping[str, Any]]) -> None:
    """Write study.toml, calibrated.toml, result.json and traces.csv."""
    (folder / "study.toml").write_text(calibration.study.text, encoding="utf-8")
    title = calibration.study.title
    notes = {name: f'calibrated by "{title}"' for name in calibration.best}
    dump_injector(calibration.injector, folder / "calibrated.toml", notes)
    record = result_record(calibration, identified)
    (folder / "result.json").write_text(json.dumps(record, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    _write_traces(folder / "traces.csv", calibration)


def read_run(folder: Path) -> tuple[dict[str, Any], dict[str, dict[str, Floats]]]:
    """result.json, and per injection curve the arrays time_s and rates [m³/s] by label.

    Raises
    ------
    InputError
        If the folder is not a run folder.
    """
    try:
        record: dict[str, Any] = json.loads((folder / "result.json").read_text(encoding="utf-8"))
        with (folder / "traces.csv").open(encoding="utf-8", newline="") as stream:
            rows = list(csv.DictReader(dropwhile(lambda line: line.startswith("#"), stream)))
    except (OSError, ValueError) as error:
        raise InputError(f"{folder}: not a run folder of commonrail calibrate ({error}).") from error
    traces: dict[str, dict[str, list[float]]] = {}
    for row in rows:
        trace = traces.setdefault(row["data"], {"time_s": []})
        trace["time_s"].append(1e-6 * float(row["time [us]"]))
        for label in _COLUMNS:
            text = row[f"{label} [mm3/ms]"]
            if text:
                trace.setdefault(label, []).append(1e-6 * float(text))
    return record, {name: {k: np.array(v) for k, v in t.items()} for name, t in traces.items()}


def _write_traces(path: Path, calibration: Calibration) -> None:
    with path.open("w", encoding="utf-8", newline="") as stream:
        synthetic = calibration.study.synthetic
        stream.write(f"# Injection curves of: {' '.join(calibration.study.title.split())}\n")
        stream.write(f"# {'SYNTHETIC: ' + ' '.join(synthetic.split()) if synthetic else 'measured data'}\n")
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["data", "time [us]", *(f"{label} [mm3/ms]" for label in _COLUMNS)])
        for i, data in enumerate(calibration.study.data):
            if not isinstance(data, RateData):
                continue
            columns = {"measured": data.rate}
            for label, scores in calibration.scores.items():
                score = scores[i]
                if isinstance(score, RateScore):
                    columns[label] = score.rate
            middles = 0.5 * (data.bounds[1:] + data.bounds[:-1])
            for k, moment in enumerate(middles):
                cells = [repr(float(columns[c][k] * 1e6)) if c in columns else "" for c in _COLUMNS]
                writer.writerow([data.name, repr(float(moment * 1e6)), *cells])
