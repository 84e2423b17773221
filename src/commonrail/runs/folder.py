"""The run folder: files that a calibration writes."""

from __future__ import annotations

import json
import re
import secrets
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from commonrail.base.arguments import file_path, instance, mapping
from commonrail.base.arrays import Floats
from commonrail.base.errors import InputError
from commonrail.base.hooks import check_unheld_stop, note
from commonrail.base.input import check_sum, check_sums, read_arrays
from commonrail.base.output import PART, replacing, write_set, write_text, writing
from commonrail.base.text import command
from commonrail.calibration.result import result_record
from commonrail.calibration.run import Calibration
from commonrail.calibration.study import Study
from commonrail.calibration.study_file import load_study
from commonrail.data.base import DataSet, Score
from commonrail.data.records import LABELS, MEAN, MEASURED, SCHEMA
from commonrail.physics.meters import is_of_meter
from commonrail.readers.injector_writer import dump_injector
from commonrail.readers.location import read_text
from commonrail.runs.journal import JOURNAL
from commonrail.runs.traces import Curve, Traces, read_traces, write_traces

# JSON records of run folders, read without trust in who wrote them.

LARGEST_RECORD = 20_000_000  # [bytes]; its tables take up to 30 times as much


# Control characters in JSON, which a terminal would execute; the group matches escaped ones.
_ESCAPES = re.compile(
    r"\\(?:(u000[0-8b-f]|u001|u007f|u00[89]|u20(?:2[a-e]|6[6-9])|[bfr])|.)|([\x7f-\x9f\u202a-\u202e\u2066-\u2069])",
    re.IGNORECASE,
)


def read_record(path: Path, made_by: str, kind: str = "") -> dict[str, Any]:
    """A record, which is one JSON object; `made_by` is the command that leaves such a file, for the message.

    `kind`: its key "kind", where such files have one. `InputError` if the file cannot be read, is no such object, is
    of another kind or schema, or is not the one that was written.
    """
    if not path.exists():
        raise _no_run(path.parent, made_by) or _broken(path, made_by, "there is no such file")
    check_sums(path.parent)
    try:
        text = read_text(path, LARGEST_RECORD)
        if any(escape.lastindex for escape in _ESCAPES.finditer(text)):
            raise ValueError("a text has control characters")
        record = json.loads(text, parse_constant=_refuse_constant)
    except (ValueError, RecursionError) as error:
        raise _broken(path, made_by, str(error)) from error
    if not isinstance(record, dict):
        raise _broken(path, made_by, "this is not one object in braces")
    where = f"{path.parent}: {path.name}"
    if kind and record.get("kind") != kind:
        raise InputError(f"{where} is not the result of {made_by}; give a folder that it left.")
    if kind and record.get("schema") != SCHEMA:
        again = made_by.removeprefix("commonrail ")
        raise InputError(f"{where} was left by another version of commonrail; {again} again.")
    return record


def _refuse_constant(text: str) -> None:
    raise ValueError(f"{text} is no number of JSON")


def write_record(path: Path, record: Mapping[str, Any]) -> dict[str, Any]:
    """Write a record whole or not at all, and return it as a reader gets it; `OutputError` if it cannot be written."""
    text = json.dumps(record, indent=1, allow_nan=False) + "\n"
    text = _ESCAPES.sub(lambda escape: " " if escape.lastindex else escape[0], text)
    write_text(path, text)
    return dict(json.loads(text))


def without_result(folder: Path) -> InputError | None:
    """Error for the folder of a run that has not come to its results; None for any other folder."""
    if not (folder / JOURNAL).is_file() or any(folder.glob("*.json")):
        return None
    again = f"`{command('resume', folder)}`"
    return InputError(f"{folder}: this run has no results yet; if it was stopped, {again} runs it to its end.")


def _no_run(folder: Path, made_by: str) -> InputError | None:
    """Error for a path without a record: a file, a study folder, nothing, an unfinished run; else None."""
    if unfinished := without_result(folder):
        return unfinished
    study = folder if folder.is_file() else folder / STUDY
    expected = f"a run folder of {made_by} is expected"
    if study.is_file():
        what = "this is a file" if study == folder else f"this is the folder of a study, {study}"
        cure = f"`{command('calibrate', study)} --out RUN` makes one"
        return InputError(f"{folder}: {what}, and {expected}; {cure}.")
    if not folder.exists():
        return InputError(f"{folder}: there is no such folder, and {expected}; `commonrail runs` lists those below.")
    return None


def _broken(path: Path, made_by: str, reason: str) -> InputError:
    return InputError(f"{path.parent}: not a run folder of {made_by} ({path.name}: {reason}); make it again.")


# Runs whose search was stopped early: users of their values are warned.

_RESULT = "result.json"


def note_stopped(folder: Path, record: Mapping[str, Any] | None = None) -> None:
    """Note, once a process, that the values of a run are those of a search that was stopped.

    By default its record is read; a folder without a record is not judged. `InputError` if a file was changed.
    """
    if record is None:
        check_sums(folder)
        with suppress(InputError):
            record = read_record(folder / _RESULT, "commonrail calibrate")
    if record is None or record.get("status") != "interrupted":
        return
    note(
        f"{folder}: the search was stopped before its end, and these are the best values up to then; "
        f"`{command('resume', folder)}` runs it to its end.",
        once=True,
    )


RESULT, STUDY, TRACES, CALIBRATED = "result.json", "study.toml", "traces.csv", "calibrated.toml"
DRAWS = "draws.npz"  # draws of the parameters from the posterior of the fit
MEMBER = "member-{}.toml"  # injectors of the other members of the fit, from number 2 on

_COLUMNS = (MEASURED, *(label for label in LABELS if label != MEAN))  # columns of time series; these have no mean


def create_run_folder(path: str | Path) -> Path:
    """Make a new run folder.

    Raises
    ------
    ConfigurationError
        If it is not a path.
    InputError
        If it exists and is not empty.
    OutputError
        If it cannot be made.
    """
    path = file_path(path, "folder")
    refuse_used(path)
    with writing(path):
        path.mkdir(parents=True, exist_ok=True)
        probe = path / f".writable{PART}"
        probe.touch()
        probe.unlink()
    return path


@contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """A temporary folder that is moved to `path` when it is complete; an error or a stop removes it.

    `InputError` if `path` is in use, `OutputError` if it cannot be written.
    """
    refuse_used(path)
    end = f".{secrets.token_hex(6)}{PART}"
    exists = path.is_dir()
    unfinished = path.resolve() / end if exists else path.with_name(path.name + end)
    with writing(path):
        unfinished.mkdir(parents=True)
    try:
        yield unfinished
        check_unheld_stop()
    except BaseException:
        shutil.rmtree(unfinished, ignore_errors=True)
        raise
    with writing(path):
        if not exists:
            unfinished.rename(path)
            return
        for entry in unfinished.iterdir():  # the folder itself may be the one that a shell is in
            entry.rename(unfinished.parent / entry.name)
        unfinished.rmdir()


def final_text(text: str, folder: Path) -> str:
    """Text that names a folder, with the name that the folder will have if it is one of `new_folder`."""
    if folder.suffix != PART:
        return text
    end = folder.name[folder.name.rindex(".", 0, -len(PART)) :]
    return text.replace(f"/{end}", "").replace(end, "")


def refuse_used(path: Path) -> None:
    """Refuse (`InputError`) a place for a new run folder that exists and is not empty, but for unfinished files."""
    if path.exists() and (not path.is_dir() or any(entry.suffix != PART for entry in path.iterdir())):
        has_run = (path / JOURNAL).is_file()
        cure = f"; `{command('resume', path)}` goes on with the run there" if has_run else ""
        raise InputError(f"{path}: there already is something; name another folder, nothing was overwritten{cure}.")


def write_run(folder: str | Path, calibration: Calibration, identified: Mapping[str, Mapping[str, Any]]) -> None:
    """Write study.toml, calibrated.toml, result.json, traces.csv and their checksums, SHA256SUMS.

    Parameters
    ----------
    folder : str or Path
    calibration : Calibration
    identified : mapping
        As `identify(calibration)` returns it.

    Raises
    ------
    ConfigurationError
        If an argument is of another kind.
    OutputError
        If a file cannot be written.
    """
    folder = file_path(folder, "folder")
    instance(calibration, Calibration, "calibration")
    mapping(identified, "identified", "what identify(calibration) returns")
    with write_set(folder):
        write_text(folder / STUDY, calibration.study.text)
        write_results(folder, calibration, identified)


class Results(NamedTuple):
    """Content of a run folder that its report shows: record, courses in time, and draws of parameters [SI] by name."""

    record: dict[str, Any]
    traces: Traces
    draws: dict[str, Floats]


def write_results(folder: Path, calibration: Calibration, identified: Mapping[str, Mapping[str, Any]]) -> Results:
    """Write calibrated.toml, the other members, result.json, traces.csv and draws.npz, and their checksums."""
    title = calibration.study.title
    notes = {name: f'calibrated by "{title}"' for name in calibration.best if not is_of_meter(name)}
    others = {MEMBER.format(number): member for number, member in enumerate(calibration.members[1:], 2)}
    former = {path.name for path in folder.glob(MEMBER.format("*"))} | {DRAWS}
    with write_set(folder, *former):
        dump_injector(calibration.injector, folder / CALIBRATED, notes, meters=calibration.meters)
        for name, injector in others.items():
            dump_injector(injector, folder / name, notes)
        record = write_record(folder / RESULT, result_record(calibration, identified))
        curves = list(rate_curves(calibration.study.data, calibration.scores))
        _write_traces(folder / TRACES, calibration.study, curves)
        names, draws = calibration.study.space.names, getattr(identified, "draws", None)
        if draws is not None:
            with replacing(folder / DRAWS, "wb") as stream:
                np.savez(stream, points=draws, names=np.array(names))
    by_name = {} if draws is None else dict(zip(names, draws.T, strict=True))
    return Results(record, {curve.data: curve.trace for curve in curves}, by_name)


def read_results(folder: Path, record: Mapping[str, Any]) -> Results:
    """Content of a run folder whose `record` is read; raises as `read_run`."""
    names = [str(parameter["name"]) for parameter in record["parameters"]]
    draws = dict(zip(names, read_draws(folder, names).T, strict=True)) if (folder / DRAWS).is_file() else {}
    return Results(dict(record), read_traces(folder / TRACES), draws)


def read_draws(folder: str | Path, names: Sequence[str], most: int | None = None) -> Floats:
    """Draws (m, d) [SI] of a run folder, for parameters of these names, at most so many of them.

    Raises `InputError` if they are missing or of other parameters.
    """
    path = file_path(folder, "folder") / DRAWS
    again = f"`{command('certainty', folder)}` draws them"
    if not path.is_file():
        raise InputError(f"{path}: there are no draws; {again}.")
    check_sum(path)
    arrays = read_arrays(path, "points", "names")
    points = np.asarray(arrays["points"], float)
    if arrays["names"].tolist() != list(names) or points.ndim != 2 or points.shape[1] != len(names):
        raise InputError(f"{path}: the draws are of other parameters than the study has; {again}.")
    return points if most is None else points[:: max(len(points) // most, 1)]


def read_result(folder: Path) -> dict[str, Any]:
    """result.json of a run folder; raises as `read_run`."""
    return read_record(folder / RESULT, "commonrail calibrate", "calibration")


def read_run(folder: str | Path) -> tuple[dict[str, Any], Traces]:
    """result.json, and per injection curve the arrays time_s [s] and rates [m³/s] by label.

    Raises
    ------
    InputError
        If the folder is not a run folder, or a file of it is broken or not the one that was written.
    ConfigurationError
        If it is not a path.
    """
    folder = file_path(folder, "folder")
    return read_result(folder), read_traces(folder / TRACES)


def read_fit(folder: str | Path) -> tuple[Study, dict[str, float]]:
    """Study of a run folder, and the best values [SI] of its result.

    Raises `InputError` if the folder is not a run folder, its result is of another study, or a file of it is broken.
    Raises `ConfigurationError` if it is not a path.
    """
    folder = file_path(folder, "folder")
    record = read_result(folder)
    note_stopped(folder, record)
    study = load_study(folder / STUDY)
    try:
        best = {str(p["name"]): float(p["best"]) for p in record["parameters"]}
    except (KeyError, OverflowError, TypeError, ValueError) as error:
        raise InputError(f"{folder}: {RESULT} has no best values ({error}); calibrate again.") from error
    if set(best) != set(study.space.names):
        raise InputError(f"{folder}: {RESULT} has other parameters than {STUDY}; calibrate again.")
    return study, best


def _write_traces(path: Path, study: Study, curves: Sequence[Curve]) -> None:
    synthetic = f"SYNTHETIC: {study.synthetic}" if study.synthetic else "measured data"
    write_traces(path, (f"Injection curves of: {study.title}", synthetic), _COLUMNS, curves)


def rate_curves(data: Sequence[DataSet], scores: Mapping[str, Sequence[Score]]) -> Iterator[Curve]:
    """Measured time series of the data, with the simulated ones by label."""
    for i, d in enumerate(data):
        if d.bounds is not None:
            simulated = {label: set_scores[i].values for label, set_scores in scores.items()}
            yield Curve(d.name, d.bounds, {MEASURED: d.measured, **simulated})
