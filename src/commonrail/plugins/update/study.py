"""Study of an update: the run's study, started at its calibrated values, with blocks for the new files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.errors import InputError
from commonrail.base.input import fingerprint
from commonrail.base.text import join_words
from commonrail.calibration.parameter import Prior
from commonrail.calibration.record import ParameterRecord
from commonrail.calibration.study import Study
from commonrail.calibration.study_file import edit_study
from commonrail.plugins.new.study import WEIGHT, StatedByUser, block_of_file, data_lines, open_keys, survey_file
from commonrail.readers.injector import load_injector
from commonrail.readers.overview import UNKNOWN, Survey
from commonrail.readers.toml import read_toml
from commonrail.runs.folder import STUDY
from commonrail.runs.journal import Input
from commonrail.runs.study_edits import append, complete, exact, parameter_table

# Keys on how the bench measures, which a new file takes from the fitted data of its kind if these agree and the file
# states none. A window is excluded: it belongs to the times of one file.
SHARED = ("meter", "noise", "weight", "absolute", "relative", "resample", "sampling", "drive", "time_zero", "shots")
_BENCH = ("cylinder_pressure", "return_pressure")
_OPTIONS = (*_BENCH, "rail_pressure", "energising_time")  # keys that an option can state
# Search near the start: refinements from the start, from hops near it, and from one of a few distant points.
LOCAL = {"members": 8, "generations": 0, "initial": "reference", "polish": 3}


class Addition(NamedTuple):
    """New data files: their surveys, and the blocks of a study that read them."""

    surveys: tuple[Survey, ...]
    blocks: tuple[dict[str, Any], ...]

    def holds(self, name: str) -> bool:
        """Return whether a data set of this name comes from one of the files."""
        return any(name == block["name"] or name.startswith(f"{block['name']}, ") for block in self.blocks)


def read_addition(
    run: Path, inputs: Sequence[Input], files: Sequence[Path], held_out: Sequence[Path], stated: StatedByUser
) -> Addition:
    """Read new files as `commonrail new --from` does, and complete their blocks from the study.

    Raises `InputError` if a file cannot be read, is in the study already, or lacks a key that neither the study nor the
    user states.
    """
    document = read_toml(run / STUDY)[0]
    sources = {item.original: item.name for item in inputs}
    sources |= {fingerprint(run / block["file"]): block["file"] for block in document["data"]}
    for path in (*files, *held_out):
        content = fingerprint(path)
        if content in sources and content:
            raise InputError(f"{path}: the study of {run} already contains this file as {sources[content]}; omit it.")
        if str(path.absolute()) in [item.origin for item in inputs]:
            raise InputError(
                f"{path}: the study of {run} has an earlier version of this file; put new rows into a separate file."
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
        bench = _complete_block({}, [document | other for other in document["data"]], _BENCH)
        block = dict.fromkeys(_BENCH, UNKNOWN) | _complete_block(
            bench | block, [bench | peer for peer in peers or [{}]]
        )
        block |= {key: text for key, text in stated.pressures.items() if text}
        if missing := open_keys(block):
            options = [f"--{key.replace('_', '-')}" for key in missing if key in _OPTIONS]
            cure = f"state {join_words(options)}" if len(options) == len(missing) else "write its block by hand"
            raise InputError(f"{survey.path}: neither the file nor the study states {join_words(missing)}; {cure}.")
        blocks.append(block)
    return Addition(surveys, tuple(blocks))


def _complete_block(
    block: Mapping[str, Any], peers: Sequence[Mapping[str, Any]], keys: Sequence[str] = (*_BENCH, *SHARED)
) -> dict[str, Any]:
    """Complete a block with the keys whose values are equal in all peers, unless its file states them."""
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


def make_updated_study(
    run: Path,
    parameters: Sequence[ParameterRecord],
    addition: Addition,
    gone: Sequence[str],
    draws: Floats | None,
    optimiser: Mapping[str, Any],
) -> Study:
    """Make the study of a run with new data, started at the calibrated values; the run's file is not changed.

    `parameters`: records in the result; `gone`: data sets to omit; `draws` (m, d) [SI]: give the priors if stated;
    `optimiser`: table of the search.
    """
    lines = data_lines(addition.surveys, list(addition.blocks), StatedByUser({}))

    def change(document: Any) -> None:
        import tomlkit  # slow to import

        for i, block in reversed(list(enumerate(document["data"]))):
            if block["name"] in gone:
                del document["data"][i]
        for block in tomlkit.parse("\n".join(lines))["data"]:
            append(document, "data", block)
        complete(document, [parameter.name for parameter in parameters])
        for i, parameter in enumerate(parameters):
            table, best, unit = parameter_table(document, parameter), parameter.best, parameter.unit
            table.pop("reference", None)
            table["start"] = exact(best, unit)
            prior = parameter.prior if "value" not in table.get("prior", {"value": 0}) else None
            if draws is not None:
                prior = Prior(best, float(np.std(draws[:, i])), f"draws of {run.name}")
            if prior is not None:
                values = {key: exact(getattr(prior, key), unit) for key in ("value", "sigma")}
                table["prior"] = tomlkit.inline_table()
                table["prior"].update(values | {"source": prior.source})
        if dict(optimiser) != document.get("optimiser", {}):
            document["optimiser"] = tomlkit.table()
            document["optimiser"].update(optimiser)

    return edit_study(run / STUDY, change)
