"""The study of one injector, made from the template: its own data files, title and seed; all paths absolute."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from commonrail.files.atomic import write_text, writing
from commonrail.files.injector_file import load_injector
from commonrail.files.type_file import load_type
from commonrail.fleet.fleet_file import Fleet, Template
from commonrail.fleet.supply import DEAD_TIMES
from commonrail.reading.guarded_file import noting_files, read_plain, sha256
from commonrail.reading.place import Place, located
from commonrail.reading.reach import ALLOW, Reach

__all__ = ["folders_of", "read_shared", "seed_of", "shared_files", "write_study"]

_COURSES = ("rail_pressure", "cylinder_pressure", "return_pressure", "drive")  # of a curve; tables if they are measured
_LONGEST = 80  # characters of a folder's name


def seed_of(seed: int, name: str) -> int:
    """Seed of an injector's search, from the fleet's seed and its name; its place in the table plays no part."""
    return int(sha256(f"{seed}\n{name}".encode())[:15], 16)  # 60 bits: a whole number of TOML has 63


def folders_of(names: Sequence[str]) -> dict[str, str]:
    """Folder for each injector: its name, if that makes a folder's name of its own, else with some digits added."""
    plain = {name: re.sub(r"[^A-Za-z0-9._-]", "_", name)[:_LONGEST] for name in names}
    counts = Counter(folder.lower() for folder in plain.values())  # some systems do not tell A from a
    return {
        name: folder
        if folder == name and counts[folder.lower()] == 1 and folder.strip(".")
        else f"{folder}-{sha256(name.encode())[:8]}"
        for name, folder in plain.items()
    }


def write_study(fleet: Fleet, name: str, folder: Path) -> Path:
    """Write the study of an injector, and its data if they are rows of a table; returns the study's path.

    Parameters
    ----------
    fleet : Fleet
    name : str
        Of the injector.
    folder : Path
        Made if it is not there.

    Notes
    -----
    The study can be run by itself, with the same result: ``commonrail calibrate FOLDER/study.toml``.
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
    tables = {ALLOW: True} | dict(template.document)  # the paths are absolute, and lead out of the member's folder
    tables["title"] = f"{template.model.title}: injector {name}"
    tables["seed"] = seed_of(fleet.seed, name)
    tables["injector"] = _absolute(base, tables["injector"]) if _is_file(tables["injector"]) else tables["injector"]
    if "type" in tables:
        tables["type"] = _absolute(base, tables["type"])
    tables["data"] = [_data(data, files, base) for data in template.document["data"] if data["name"] in files]
    if "meters" in tables:
        seen = {data.get("meter") for data in tables["data"]}
        tables["meters"] = {n: m for n, m in tables["meters"].items() if n in seen or _is_fitted(m)}
    return f"# Made by commonrail fleet from {template.path.name}.\n{tomlkit.dumps(tables)}"


def _is_fitted(meter: Mapping[str, Any]) -> bool:
    """True if any quantity of a meter's table has bounds."""
    return any(isinstance(value, Mapping) and "lower" in value for value in meter.values())


def _data(data: Mapping[str, Any], files: Mapping[str, Path], base: Path) -> dict[str, Any]:
    own = dict(data, file=str(files[data["name"]].absolute()))
    for key in _COURSES:
        if isinstance(own.get(key), dict) and "file" in own[key]:
            own[key] = dict(own[key], file=_absolute(base, own[key]["file"]))
    if "dead_times" in own:
        dead = files.get(data["name"] + DEAD_TIMES)
        if dead is None:
            del own["dead_times"]
        else:
            own["dead_times"] = dict(own["dead_times"], file=str(dead.absolute()))
    return own


def shared_files(template: Template) -> dict[str, Path]:
    """Files that are the same for all injectors, by the names that the template gives them."""
    names = [template.model.injector] if _is_file(template.model.injector) else []
    names += [template.model.type] if template.model.type else []
    for data in template.document["data"]:
        courses = [data[key] for key in _COURSES if isinstance(data.get(key), dict)]
        names += [course["file"] for course in courses if "file" in course and data["name"] not in template.left_out]
    return {name: template.path.parent / name for name in names}


def read_shared(template: Template) -> dict[Path, str]:
    """SHA-256 of those files, and of the files that the injector's file names in turn.

    Raises
    ------
    InputError
        If one cannot be read.
    """
    with noting_files() as noted, located(Place(str(template.path))):
        for name, path in shared_files(template).items():
            if name == template.model.injector:
                load_injector(path, Reach(template.path, outside=True))
            elif name == template.model.type:
                load_type(path, Reach(template.path, outside=True))
            read_plain(path)
    return noted


def _is_file(injector: str) -> bool:
    return injector.endswith(".toml")


def _absolute(base: Path, file: str) -> str:
    return str((base / file).absolute())
