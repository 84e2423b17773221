"""Study of an update: that of a run, started at its calibrated values, with blocks for the new data files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.errors import InputError
from commonrail.base.input import fingerprint
from commonrail.base.text import join_words
from commonrail.calibration.study import Study
from commonrail.calibration.study_file import edit_study
from commonrail.plugins.new.study import WEIGHT, StatedByUser, block_of_file, data_lines, open_keys, survey_file
from commonrail.readers.injector import load_injector
from commonrail.readers.overview import UNKNOWN, Survey
from commonrail.readers.toml import read_toml
from commonrail.runs.folder import STUDY
from commonrail.runs.journal import Input
from commonrail.runs.study_edits import append, complete, exact, table_of

# Keys that a new file takes over from the fitted data of its kind, where these agree and the file does not state its
# own: how the bench measures. A window is not among them: it belongs to the times of one file.
SHARED = ("meter", "noise", "weight", "absolute", "relative", "resample", "sampling", "drive", "time_zero", "shots")
_BENCH = ("cylinder_pressure", "return_pressure")
_OPTIONS = (*_BENCH, "rail_pressure", "energising_time")  # that state a key of a block
# A search near the start: refinements from it and from hops near it, and from one of a few points far away.
LOCAL = {"members": 8, "generations": 0, "initial": "reference", "polish": 3}


class Addition(NamedTuple):
    """New data files: their surveys, and the blocks of a study that read them."""

    surveys: tuple[Survey, ...]
    blocks: tuple[dict[str, Any], ...]

    def holds(self, name: str) -> bool:
        """Return whether a data set of this name is of one of the files."""
        return any(name == block["name"] or name.startswith(f"{block['name']}, ") for block in self.blocks)


def read_addition(
    run: Path, inputs: Sequence[Input], files: Sequence[Path], held_out: Sequence[Path], stated: StatedByUser
) -> Addition:
    """Read new files as `commonrail new --from` does, and complete their blocks by those of their kind in the study.

    Raises `InputError` if a file cannot be read, is in the study already, or leaves a key open that neither the study
    nor the user states.
    """
    document = read_toml(run / STUDY)[0]
    sources = {item.original: item.name for item in inputs}
    sources |= {fingerprint(run / block["file"]): block["file"] for block in document["data"]}
    for path in (*files, *held_out):
        content = fingerprint(path)
        if content in sources and content:
            raise InputError(f"{path}: this is {sources[content]}, which the study of {run} has already; omit it.")
        if str(path.absolute()) in [item.origin for item in inputs]:
            raise InputError(
                f"{path}: the study of {run} has this file as it was before; put new rows into a file of their own."
            )
        sources[content] = str(path)
    injector = str(document["injector"])
    model = load_injector(run / injector if injector.endswith(".toml") else injector)
    surveys, blocks = tuple(survey_file(path, stated) for path in (*files, *held_out)), list[dict[str, Any]]()
    for survey in surveys:
        others = [*document["data"], *blocks]
        block = block_of_file(survey, surveys, model, stated)
        block |= {"file": str(survey.path.absolute()), "role": "validation" if survey.path in held_out else "fit"}
        while block["name"] in [other["name"] for other in others]:
            block["name"] += "-2"
        peers = [other for other in document["data"] if other["kind"] == block["kind"]]
        peers = [other for other in peers if other["role"] == "fit"] or peers
        if block["kind"] == "quantities" and not peers and any(other["kind"] == "rate" for other in others):
            block["weight"] = WEIGHT
        bench = _completed({}, [document | other for other in document["data"]], _BENCH)
        block = dict.fromkeys(_BENCH, UNKNOWN) | _completed(bench | block, [bench | peer for peer in peers or [{}]])
        block |= {key: text for key, text in stated.pressures.items() if text}
        if missing := open_keys(block):
            options = [f"--{key.replace('_', '-')}" for key in missing if key in _OPTIONS]
            cure = f"state {join_words(options)}" if len(options) == len(missing) else "write its block by hand"
            raise InputError(f"{survey.path}: neither the file nor the study tells {join_words(missing)}; {cure}.")
        blocks.append(block)
    return Addition(surveys, tuple(blocks))


def _completed(
    block: Mapping[str, Any], peers: Sequence[Mapping[str, Any]], keys: Sequence[str] = (*_BENCH, *SHARED)
) -> dict[str, Any]:
    """A block with the keys of its peers that all of these state alike, where its file does not tell them."""
    full_block = dict(block)
    for key in keys:
        value = peers[0].get(key)
        if value is None or any(peer.get(key) != value for peer in peers):
            continue
        if isinstance(value, Mapping) and isinstance(full_block.get(key), Mapping):
            full_block[key] |= {inner: value.get(inner, UNKNOWN) for inner in open_keys(full_block[key])}
        elif key not in ("shots", "drive") and full_block.get(key, UNKNOWN) == UNKNOWN:
            full_block[key] = value
    return full_block


def updated_study(
    run: Path,
    parameters: Sequence[Mapping[str, Any]],
    addition: Addition,
    gone: Sequence[str],
    draws: Floats | None,
    optimiser: Mapping[str, Any],
) -> Study:
    """Study of a run with new data, started at its calibrated values; the run's own file stays as it is.

    `parameters`: their records in the result; `gone`: data sets to leave out; `draws` (m, d) [SI]: become priors if
    stated; `optimiser`: table of the search.
    """
    lines = data_lines(addition.surveys, list(addition.blocks), StatedByUser({}))

    def change(document: Any) -> None:
        import tomlkit  # slow to import

        for i, block in reversed(list(enumerate(document["data"]))):
            if block["name"] in gone:
                del document["data"][i]
        for block in tomlkit.parse("\n".join(lines))["data"]:
            append(document, "data", block)
        complete(document, [parameter["name"] for parameter in parameters])
        for i, parameter in enumerate(parameters):
            table, best, unit = table_of(document, parameter), parameter["best"], parameter["unit"]
            table.pop("reference", None)
            table["start"] = exact(best, unit)
            prior = parameter.get("prior", {}) if "value" not in table.get("prior", {"value": 0}) else {}
            if draws is not None:
                prior = {"value": best, "sigma": float(np.std(draws[:, i])), "source": f"draws of {run.name}"}
            if prior:
                table["prior"] = tomlkit.inline_table()
                table["prior"].update(prior | {key: exact(prior[key], unit) for key in ("value", "sigma")})
        if dict(optimiser) != document.get("optimiser", {}):
            document["optimiser"] = tomlkit.table()
            document["optimiser"].update(optimiser)

    return edit_study(run / STUDY, change)
