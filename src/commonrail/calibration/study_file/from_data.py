"""A study written from an injector and data files: one block for each file, as `survey` understands it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

from commonrail.base.errors import InputError
from commonrail.base.input import read_plain
from commonrail.base.output import replacing, write_text, writing
from commonrail.physics.injector import Injector
from commonrail.readers.injector.file import load_injector
from commonrail.readers.overview import UNKNOWN, ZERO, Survey, survey

# A folder to start from: a commented injector, a study and an example curve, which the user replaces.

# Names below `templates`, in the order in which a person reads them.
TEMPLATES = ("README.md", "injector.toml", "study.toml", "data/evi.csv")


def write_new(folder: Path) -> list[Path]:
    """Write an injector, a study, an example curve and a README into a new or empty folder.

    Parameters
    ----------
    folder : Path

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    InputError
        If something is there already; nothing is overwritten.
    OutputError
        If the folder cannot be written.
    """
    templates = resources.files("commonrail.calibration.study_file") / "template"
    return write_into(folder, {name: (templates / name).read_bytes() for name in TEMPLATES})


def write_into(folder: Path, files: Mapping[str, bytes]) -> list[Path]:
    """Write files into a new or empty folder.

    Parameters
    ----------
    folder : Path
    files : mapping of str to bytes
        Content by the path below the folder.

    Raises
    ------
    InputError, OutputError
        As `write_new`.
    """
    with writing(folder):
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise InputError(f"{folder}: there already is something; name a new or empty folder.")
        written = []
        for name, content in files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
            written.append(path)
    return written


# Free parameters to begin with: what the quantity depends on most and drawings know least.
_FREE = ("control_chamber.z_hole_diameter", "control_chamber.a_hole_diameter", "nozzle.discharge_maximum")
_FREE_OF_DIRECT = ("nozzle.discharge_maximum", "needle_seat.diameter")

_MEANINGS = {
    "cylinder_pressure": "pressure behind the nozzle",
    "return_pressure": "pressure at the end of the return line",
    "rail_pressure": "the file does not tell it",
    "energising_time": "the file does not tell it",
    "time_zero": "time of the file at which energising starts",
    "shots": "offset, from the trigger's edge to the start of energising",
}


class BenchPressures(NamedTuple):
    """Pressures that no data file tells, as texts with their units; empty where they are to be stated later."""

    cylinder: str = ""
    back: str = ""


class Started(NamedTuple):
    """A study that was written.

    Attributes
    ----------
    study : Path
    files : tuple of Path
        All that were written.
    surveys : tuple of Survey
        What each data file was taken for.
    open : tuple of str
        Keys that are to be stated.
    assumed : tuple of str
        Keys that no file tells and that have a value nevertheless, to be checked.
    """

    study: Path
    files: tuple[Path, ...]
    surveys: tuple[Survey, ...]
    open: tuple[str, ...]
    assumed: tuple[str, ...]


def write_study_from(folder: Path, injector: str, sources: Sequence[Path], pressures: BenchPressures) -> Started:
    """Write a study into a new or empty folder, with copies of the data files.

    Parameters
    ----------
    folder : Path
    injector : str
        Name of the catalogue, or a TOML file, which is copied.
    sources : sequence of Path
        Data files, see `survey`.
    pressures : BenchPressures

    Raises
    ------
    InputError
        If something is in the folder already, a file cannot be read, is no data of a study, or two have one name.
    OutputError
        If the folder cannot be written.
    """
    model = load_injector(injector)
    surveys = tuple(survey(path) for path in sources)
    for found in surveys:
        if not found.block:
            raise InputError(
                f"{found.path}: taken for {found.taken_for}; write its block by hand, or correct the file."
            )
    names = [path.name for path in sources]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"Two of the data files are called {twice}; rename one.")
    with writing(folder):
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise InputError(f"{folder}: there already is something; name a new or empty folder.")
        (folder / "data").mkdir(parents=True, exist_ok=True)
        copies = [_copy(path, folder / "data" / path.name) for path in sources]
        if injector.endswith(".toml"):
            copies.append(_copy(Path(injector), folder / "injector.toml"))
            injector = "injector.toml"
        study = folder / "study.toml"
        text, missing = _text(injector, model, surveys, pressures)
        write_text(study, text)
    assumed = tuple(f"data[{i}].time_zero" for i, s in enumerate(surveys, 1) if s.block.get("time_zero") == ZERO)
    return Started(study, (study, *copies), surveys, missing, assumed)


def _copy(source: Path, target: Path) -> Path:
    with replacing(target, "wb") as stream:
        stream.write(read_plain(source))
    return target


def _text(
    injector: str, model: Injector, surveys: Sequence[Survey], pressures: BenchPressures
) -> tuple[str, tuple[str, ...]]:
    """Text of the study, and the keys that are to be stated."""
    lines = [
        "# A calibration: which data, which parameters are free, within which bounds. Paths start at this folder.",
        "",
        'format = "commonrail-study/1"',
        f"title = {_toml(f'Calibration of {injector}')}",
        f"injector = {_toml(injector)}",
        "seed = 1 # the same seed gives the same result",
        "",
    ]
    missing: list[str] = []
    for i, found in enumerate(surveys):
        names = [s.path.stem for s in surveys]
        name = found.path.name if names.count(found.path.stem) > 1 else found.path.stem
        keys: dict[str, Any] = {"kind": found.block["kind"], "name": name, "role": "fit"}
        keys |= found.block | {"file": f"data/{found.path.name}"}
        keys |= {"cylinder_pressure": pressures.cylinder or UNKNOWN, "return_pressure": pressures.back or UNKNOWN}
        keys |= {"source": f"{found.path.name}, as it came", "synthetic": ""}
        missing += [f"data[{i + 1}].{key}" for key in _open(keys)]
        lines += [f"# {found.taken_for}{'; ' + found.said if found.said else ''}", "[[data]]"]
        lines += [_line(key, value) for key, value in keys.items()] + [""]
    for parameter in _FREE if _FREE[0] in model.values else _FREE_OF_DIRECT:
        lines += ["[[parameter]]", f"name = {_toml(parameter)}", 'below = "10 %"', 'above = "10 %"', ""]
    lines += ["[optimiser] # differential evolution, then `polish` refinements by least squares"]
    lines += ["members = 24", "generations = 30", "polish = 3", ""]
    return "\n".join(lines), tuple(missing)


def _open(keys: Mapping[str, Any]) -> list[str]:
    """Keys whose values are unknown, those of an inline table with its name."""
    found = [key for key, value in keys.items() if value == UNKNOWN]
    for key, value in keys.items():
        found += [f"{key}.{inner}" for inner in _open(value)] if isinstance(value, Mapping) else []
    return found


def _line(key: str, value: Any) -> str:
    comments = {
        "role": '"fit", or "validation": compared, not fitted',
        "window": "samples that count, from the start of energising",
        "synthetic": "what about the data is not measured",
    }
    if key == "time_zero" and value == ZERO:
        comments[key] = f"CHECK IT: {_MEANINGS[key]}; no file tells it"
    if _open({key: value}) and key in _MEANINGS:
        comments[key] = f"STATE IT: {_MEANINGS[key]}"
    return f"{key} = {_toml(value)}" + (f" # {comments[key]}" if key in comments else "")


def _toml(value: Any) -> str:
    """Value as TOML: a text, a list or an inline table of texts."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {_toml(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    import tomlkit

    return tomlkit.string(str(value)).as_string()
