"""Injectors that an earlier run has calibrated: taken over if they are this fleet's, to these data, and undamaged."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from commonrail.compile_target import package_versions
from commonrail.errors import StudyError
from commonrail.files.meter_models import free_names
from commonrail.fleet.fleet_file import Fleet
from commonrail.fleet.journal import FAILED, FINISHED, JOURNAL, Entry, Journal
from commonrail.fleet.member import shared_files
from commonrail.fleet.supply import MISSING_FILE
from commonrail.reading.guarded_file import sha256
from commonrail.store.faults import trusted

__all__ = ["check_entries", "entries_of"]

_CURE = "bring it back as it was, or take another folder."

Count = Annotated[int, Field(ge=0)]


class _Part(BaseModel):
    model_config = ConfigDict(strict=True, allow_inf_nan=False, extra="forbid")


class _Costs(_Part):
    start: float | None
    best: float


class _Data(_Part):
    name: str
    role: str
    measure: str
    unit: str
    start: float | None
    best: float | None


class _Prior(_Part):
    value: float
    sigma: float


class _Parameter(_Part):
    best: float
    standard_error: float | None
    verdict: str
    position: float
    at_bound: bool
    lower: float
    upper: float
    prior: _Prior | None = None


class _Fixed(_Part):
    name: str
    value: float
    mark: str
    source: str


class _Warning(_Part):
    code: str
    subject: str
    sentence: str


class _Record(_Part):
    seed: Count
    synthetic: str
    J: _Costs
    slots: Count
    simulated: Count
    failed: Count
    data: list[_Data]
    fixed: list[_Fixed]
    parameters: dict[str, _Parameter]
    warnings: list[_Warning]


def check_entries(fleet: Fleet, entries: Mapping[str, Entry], folder: Path) -> None:
    """Refuse what no worker has told, or has told of another template.

    Parameters
    ----------
    fleet : Fleet
    entries : mapping of str to Entry
    folder : Path
        Of the journal that holds them.

    Raises
    ------
    StudyError
        If there is such a record.
    """
    model = fleet.template.model
    data, parameters = {d.name for d in model.data}, {p.name for p in model.parameter} | {*free_names(model.meters)}
    with trusted(folder / JOURNAL):
        for entry in entries.values():
            if entry.status == FINISHED:
                found = _Record.model_validate(entry.record)
                if not {part.name for part in found.data} <= data or set(found.parameters) != parameters:
                    raise ValueError("other data sets or parameters than the template's")


def entries_of(
    fleet: Fleet, inputs: Mapping[str, Mapping[str, str]], journal: Journal, shared: Mapping[Path, str]
) -> dict[str, Entry]:
    """Injectors of a fleet that are done; to a journal without any, the fleet is made known.

    Parameters
    ----------
    fleet : Fleet
    inputs : mapping
        Fingerprints of the data files of each injector.
    journal : Journal
    shared : mapping of Path to str
        As `read_shared` returns it.

    Raises
    ------
    StudyError
        If another fleet was begun there, or an injector was calibrated to other data; some may have been added.
    """
    folder, entries = journal.path.parent, journal.entries()
    now, before = _common(fleet, shared), journal.inputs()
    if entries and not before:
        raise StudyError(f"{journal.path}: the journal is damaged: it does not tell which fleet it is of; {_CURE}")
    if entries and (changed := _changed(before, now)):
        raise StudyError(f"{folder} {_difference(changed, before, now)}; {_CURE}")
    journal.write_inputs(now)  # while nothing is calibrated, a fault of the template may be mended
    for name, entry in entries.items():
        if entry.status == FAILED:
            continue
        if name not in inputs:
            raise StudyError(f'{folder} has injector "{name}", which {fleet.supply.path} has no more; {_CURE}')
        own = inputs[name]
        if own != entry.inputs:
            changed = next(s for s in {**entry.inputs, **own} if entry.inputs.get(s) != own.get(s))
            what = "is missing now" if own.get(changed) == MISSING_FILE else "has changed since"
            raise StudyError(
                f'{folder} has injector "{name}" calibrated to other data: its file of "{changed}" {what}; {_CURE}'
            )
    found = {name: entry for name, entry in entries.items() if name in inputs}
    check_entries(fleet, found, folder)
    return found


def _changed(before: Mapping[str, str], now: Mapping[str, str]) -> str:
    """Name of an input that is another now, "" if there is none."""
    return next((name for name in {**before, **now} if before.get(name) != now.get(name)), "")


def _common(fleet: Fleet, shared: Mapping[Path, str]) -> dict[str, str]:
    """Inputs that determine the result of every injector, by name: texts where readable, fingerprints of files."""
    template = fleet.template
    found = {"seed": str(fleet.seed), "leave_out": ", ".join(template.left_out)}
    found |= {f"version of {name}": version for name, version in package_versions().items()}
    found[f"file {template.path.name}"] = sha256(template.text.encode())
    names = {Path(os.path.abspath(path)): name for name, path in shared_files(template).items()}
    return found | {f"file {names.get(path, path.name)}": digest for path, digest in shared.items()}


def _difference(name: str, before: Mapping[str, str], now: Mapping[str, str]) -> str:
    if name.startswith("file "):
        return f"was begun with another {name.removeprefix('file ')}"
    return f'was begun with {name} "{before.get(name, "")}", and it is "{now.get(name, "")}" now'
