"""Study of one injector of a fleet: written from the template with its data, title and seed, and calibrated."""

from __future__ import annotations

import json
import os
import re
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from commonrail.base.errors import CommonrailError
from commonrail.base.input import noting_files, read_plain, sha256
from commonrail.base.output import write_text, writing
from commonrail.base.record import Key, to_record
from commonrail.base.text import number
from commonrail.calibration.identifiability import ParameterVerdict
from commonrail.calibration.plausibility import Finding
from commonrail.calibration.record import StartAndBest
from commonrail.calibration.run import Calibration, calibrate
from commonrail.calibration.scoring import scores_of
from commonrail.calibration.study import Study
from commonrail.calibration.study_file import load_study
from commonrail.compiler.target import package_versions
from commonrail.data.base import DataSet, Role, Score
from commonrail.plugins.certainty.linear import certify_near
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


def hash_common_inputs(fleet: Fleet, shared: Mapping[Path, str]) -> dict[str, str]:
    """Return the inputs common to all injectors, by name: readable texts, or fingerprints of files.

    `shared`: SHA-256 of the shared files.
    """
    template = fleet.template
    inputs = {"seed": str(fleet.seed), "leave_out": ", ".join(template.left_out)}
    inputs |= {f"version of {name}": version for name, version in package_versions().items()}
    inputs[f"file {template.path.name}"] = sha256(template.text.encode())
    names = {Path(os.path.abspath(path)): name for name, path in list_shared_files(template).items()}
    return inputs | {f"file {names.get(path, path.name)}": digest for path, digest in shared.items()}


def _is_file(injector: str) -> bool:
    return injector.endswith(".toml")


def _absolute(base: Path, file: str) -> str:
    return str((base / file).absolute())


# Calibration of one injector on a worker, and its record.


class MemberData(NamedTuple):
    """Errors of a data set with the start and the best values; None if they could not be simulated."""

    name: str
    role: Role
    measure: str
    unit: str
    start: float | None
    best: float | None


class FixedRecord(NamedTuple):
    """Value [SI] that the study of an injector fixes."""

    name: str
    value: float
    mark: str
    source: str


class PriorRecord(NamedTuple):
    """Prior of a parameter [SI]."""

    value: float
    sigma: float


class MemberParameter(NamedTuple):
    """Calibrated parameter of an injector [SI]; `position`: between the bounds, 0 to 1."""

    best: float
    standard_error: float | None
    verdict: ParameterVerdict
    position: float
    at_bound: bool
    lower: float
    upper: float
    prior: PriorRecord | None


class MemberRecord(NamedTuple):
    """Calibration of an injector, as the journal keeps it.

    `slots`, `simulated`, `failed`: numbers of candidates; `cost`: objective of the fitted data.
    """

    seed: int
    synthetic: str
    cost: Annotated[StartAndBest, Key("J")]
    slots: int
    simulated: int
    failed: int
    data: tuple[MemberData, ...]
    fixed: tuple[FixedRecord, ...]
    parameters: Mapping[str, MemberParameter]
    warnings: tuple[Finding, ...]

    @property
    def best_cost(self) -> float:
        """Objective of the best values."""
        assert self.cost.best is not None  # a search without a simulated candidate fails
        return self.cost.best

    @property
    def bounded(self) -> tuple[str, ...]:
        """Names of the parameters at a bound."""
        return tuple(name for name, parameter in self.parameters.items() if parameter.at_bound)


class Attempt(NamedTuple):
    """Outcome of an injector on its worker: its record, or the sentence of an error; processor time [s].

    `files`: SHA-256 of each file as it was read.
    """

    record: MemberRecord | None
    reason: str
    seconds: float
    files: Mapping[Path, str] = {}


def record_failure(error: CommonrailError, seconds: float = 0.0) -> Attempt:
    """Return the attempt that ended with an error."""
    return Attempt(None, " ".join(str(error).split()), seconds)


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
        errors = [_measure_errors(d, s, s) for d, s in zip(self.first.data, scores, strict=True)]
        return json.dumps(to_record(errors)).encode()


def calibrate_study(study: Study) -> MemberRecord:
    """Calibrate the study of an injector on one thread, and return its record for the fleet.

    Raises `CommonrailError` if the study cannot be run, or no candidate can be simulated.
    """
    calibration = calibrate(study, threads=1)
    if calibration.status != "finished":
        raise KeyboardInterrupt
    counts, scores = calibration.counts, calibration.scores
    return MemberRecord(
        seed=study.seed,
        synthetic=study.synthetic,
        cost=StartAndBest(number(calibration.start_cost), number(calibration.cost)),
        slots=counts.slots,
        simulated=counts.simulated,
        failed=counts.failed,
        data=tuple(map(_measure_errors, study.data, scores["start"], scores["best"])),
        fixed=tuple(
            FixedRecord(name, study.injector.values[name], *study.injector.sources[name]) for name in study.fixed
        ),
        parameters=_parameters(calibration),
        warnings=calibration.warnings,
    )


def _measure_errors(data: DataSet, start: Score, best: Score) -> MemberData:
    return MemberData(data.name, data.role, *data.error_head, number(start.error), number(best.error))


def _parameters(calibration: Calibration) -> dict[str, MemberParameter]:
    certain = certify_near(calibration.study, calibration.best, 1)
    records = {}
    for p in calibration.study.space.parameters:
        best = calibration.best[p.name]
        records[p.name] = MemberParameter(
            best=best,
            standard_error=certain[p.name].standard_error,
            verdict=certain[p.name].verdict,
            position=p.position(best),
            at_bound=p.is_at_bound(best),
            lower=p.lower,
            upper=p.upper,
            prior=None if p.prior is None else PriorRecord(p.prior.value, p.prior.sigma),
        )
    return records
