"""Study of one injector of a fleet: written from the template with its data, title and seed, and calibrated."""

from __future__ import annotations

import json
import re
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from commonrail.base.errors import CommonrailError
from commonrail.base.input import noting_files, read_plain, sha256
from commonrail.base.output import write_text, writing
from commonrail.base.record import to_record
from commonrail.base.text import number
from commonrail.calibration.run import Calibration, calibrate
from commonrail.calibration.scoring import scores_of
from commonrail.calibration.study import Study
from commonrail.calibration.study_file import load_study
from commonrail.data.base import DataSet, Score
from commonrail.physics.injector import Injector
from commonrail.plugins.certainty.linear import Near, certify_near
from commonrail.plugins.family.injector_type import load_type
from commonrail.plugins.fleet.study import DEAD_TIMES, Fleet, Template
from commonrail.readers.injector import load_injector
from commonrail.readers.location import ALLOW, Place, Reach, locate_errors

_COURSES = ("rail_pressure", "cylinder_pressure", "return_pressure", "drive")  # of a curve; a table if measured
_LONGEST = 80  # characters of a folder's name


def derive_seed(seed: int, name: str) -> int:
    """Derive the seed of an injector's search from the fleet's seed and the injector's name."""
    return int(sha256(f"{seed}\n{name}".encode())[:15], 16)  # 60 bits: an integer of TOML has 63


def name_folders(names: Sequence[str]) -> dict[str, str]:
    """Name a folder for each injector: its name, with digits added if it is not a valid and unique folder name."""
    plain = {name: re.sub(r"[^A-Za-z0-9._-]", "_", name)[:_LONGEST] for name in names}
    counts = Counter(folder.lower() for folder in plain.values())  # some file systems ignore case
    return {
        name: folder
        if folder == name and counts[folder.lower()] == 1 and folder.strip(".")
        else f"{folder}-{sha256(name.encode())[:8]}"
        for name, folder in plain.items()
    }


def write_study(fleet: Fleet, name: str, folder: Path) -> Path:
    """Write the study of an injector, and its data if they are rows of a table; return the study's path.

    ``commonrail calibrate FOLDER/study.toml`` gives the same result.
    """
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    files = fleet.supply.deliver(name, folder)
    path = folder / "study.toml"
    write_text(path, _text(fleet, name, files))
    return path


def _text(fleet: Fleet, name: str, files: Mapping[str, Path]) -> str:
    import tomlkit  # slow to import

    template = fleet.template
    base = template.path.parent
    tables = {ALLOW: True} | dict(template.document)  # the paths are absolute, outside the member's folder
    tables["title"] = f"{template.model.title}: injector {name}"
    tables["seed"] = derive_seed(fleet.seed, name)
    tables["injector"] = _absolute(base, tables["injector"]) if _is_file(tables["injector"]) else tables["injector"]
    if "type" in tables:
        tables["type"] = _absolute(base, tables["type"])
    tables["data"] = [_data(data, files, base) for data in template.document["data"] if data["name"] in files]
    if "meters" in tables:
        seen = {data.get("meter") for data in tables["data"]}
        fitted = {
            name
            for name, meter in tables["meters"].items()
            if any(isinstance(value, Mapping) and "lower" in value for value in meter.values())
        }
        tables["meters"] = {name: meter for name, meter in tables["meters"].items() if name in seen | fitted}
    return f"# Made by commonrail fleet from {template.path.name}.\n{tomlkit.dumps(tables)}"


def _data(data: Mapping[str, Any], files: Mapping[str, Path], base: Path) -> dict[str, Any]:
    member_data = dict(data, file=str(files[data["name"]].absolute()))
    for key in _COURSES:
        if isinstance(member_data.get(key), dict) and "file" in member_data[key]:
            member_data[key] = dict(member_data[key], file=_absolute(base, member_data[key]["file"]))
    if "dead_times" in member_data:
        dead = files.get(data["name"] + DEAD_TIMES)
        if dead is None:
            del member_data["dead_times"]
        else:
            member_data["dead_times"] = dict(member_data["dead_times"], file=str(dead.absolute()))
    return member_data


def list_shared_files(template: Template) -> dict[str, Path]:
    """List the files common to all injectors, by their names in the template."""
    names = [template.model.injector] if _is_file(template.model.injector) else []
    names += [template.model.type] if template.model.type else []
    for data in template.document["data"]:
        courses = [data[key] for key in _COURSES if isinstance(data.get(key), dict)]
        names += [course["file"] for course in courses if "file" in course and data["name"] not in template.left_out]
    return {name: template.path.parent / name for name in names}


def hash_shared_files(template: Template) -> dict[Path, str]:
    """Return SHA-256 of the shared files, and of the files named in the injector's file.

    Raises `InputError` if one cannot be read.
    """
    with noting_files() as noted, locate_errors(Place(str(template.path))):
        for name, path in list_shared_files(template).items():
            if name == template.model.injector:
                load_injector(path, Reach(template.path, outside=True, announced=True))
            elif name == template.model.type:
                load_type(path, Reach(template.path, outside=True, announced=True))
            read_plain(path)
    return noted


def _is_file(injector: str) -> bool:
    return injector.endswith(".toml")


def _absolute(base: Path, file: str) -> str:
    return str((base / file).absolute())


# Calibration of one injector on a worker, and its record.


class Attempt(NamedTuple):
    """Outcome of an injector on its worker: its record, or the sentence of an error; processor time [s].

    `files`: SHA-256 of each file as it was read.
    """

    record: Mapping[str, Any]
    reason: str
    seconds: float
    files: Mapping[Path, str] = {}


def record_failure(error: CommonrailError, seconds: float = 0.0) -> Attempt:
    """Return the attempt that ended with an error."""
    return Attempt({}, " ".join(str(error).split()), seconds)


class Calibrations:
    """Work of a fleet's workers: calibrate an injector; `first`: study to test a worker."""

    def __init__(self, first: Study | None) -> None:
        self.first = first

    def __call__(self, source: Study | Path) -> Attempt:
        """Calibrate a study, or the study in a file."""
        start = time.thread_time()  # does not depend on the load of the machine
        try:
            study = load_study(source) if isinstance(source, Path) else source
            record = calibrate_study(study)
        except CommonrailError as error:
            return record_failure(error, time.thread_time() - start)
        return Attempt(record, "", time.thread_time() - start, dict(study.files))

    @property
    def same_bits(self) -> bool:
        """True if all workers must give the same bits: as in the studies, but not for least squares."""
        return self.first is not None and self.first.same_bits and self.first.method.is_evolution

    def probe(self) -> bytes:
        """Return errors of the first study's start values; this also loads everything that a study needs."""
        if self.first is None:
            return b""
        scores = scores_of(self.first, self.first.injector, 1)["best"]
        return json.dumps([_data_record(d, s, s) for d, s in zip(self.first.data, scores, strict=True)]).encode()


def calibrate_study(study: Study) -> dict[str, Any]:
    """Calibrate the study of an injector on one thread, and return its record for the fleet.

    Raises `CommonrailError` if the study cannot be run, or no candidate can be simulated.
    """
    calibration = calibrate(study, threads=1)
    if calibration.status != "finished":
        raise KeyboardInterrupt
    counts = calibration.counts
    return {
        "seed": study.seed,
        "synthetic": study.synthetic,
        "J": {"start": number(calibration.start_cost), "best": number(calibration.cost)},
        "slots": counts.slots,
        "simulated": counts.simulated,
        "failed": counts.failed,
        "data": [
            _data_record(d, calibration.scores["start"][i], calibration.scores["best"][i])
            for i, d in enumerate(study.data)
        ],
        "fixed": [_fixed_record(study.injector, name) for name in study.fixed],
        "parameters": _parameters(calibration, certify_near(study, calibration.best, 1)),
        "warnings": to_record(calibration.warnings),
    }


def _fixed_record(injector: Injector, name: str) -> dict[str, Any]:
    mark, source = injector.sources[name]
    return {"name": name, "value": injector.values[name], "mark": mark, "source": source}


def _data_record(data: DataSet, start: Score, best: Score) -> dict[str, Any]:
    measure, unit = data.error_head
    scores = {"name": data.name, "role": data.role.value, "measure": measure, "unit": unit}
    return scores | {"start": number(start.error), "best": number(best.error)}


def _parameters(calibration: Calibration, certain: Mapping[str, Near]) -> dict[str, dict[str, Any]]:
    space = calibration.study.space
    records = {}
    for p in space.parameters:
        best = calibration.best[p.name]
        records[p.name] = {
            "best": best,
            "standard_error": certain[p.name].standard_error,
            "verdict": certain[p.name].verdict.value,
            "position": p.position(best),
            "at_bound": p.is_at_bound(best),
            "lower": p.lower,
            "upper": p.upper,
            "prior": None if p.prior is None else {"value": p.prior.value, "sigma": p.prior.sigma},
        }
    return records
