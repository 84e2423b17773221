"""Changes since a run or a fleet was computed: of its study, of its files, and of the target of the compiler."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

from commonrail.base.errors import InputError, StudyError
from commonrail.base.input import fingerprint, sha256
from commonrail.base.output import write_set, write_text
from commonrail.base.text import command
from commonrail.calibration.objective import Objective
from commonrail.calibration.plausibility import Finding, make_finding
from commonrail.calibration.search import Searched
from commonrail.calibration.study import Study
from commonrail.compiler.target import differences, package_versions
from commonrail.readers.injector_writer import injector_text
from commonrail.readers.location import read_text
from commonrail.readers.toml import LARGEST_TOML
from commonrail.runs.journal import Input, Journal

# Fingerprint of a study: equal fingerprints mean identical searches.

_TOLD = frozenset(
    {"text", "files", "as_read", "author", "logo"}
)  # fields of a study that appear in reports but do not affect results


def hash_study(study: Study) -> str:
    """SHA-256 of everything that determines a study's result, except the number of generations; file names do not."""
    space = study.space
    parts = {f.name: getattr(study, f.name) for f in fields(study) if f.name not in _TOLD}
    return hash_values(
        parts
        | {
            "injector": injector_text(study.injector, {}, ""),
            "space": (space.parameters, space.rows.matrix, space.rows.labels, space.products.constraints),
            "method": replace(study.method, evolution=replace(study.method.evolution, generations=0)),
        }
    )


def hash_values(*values: Any) -> str:
    """SHA-256 of values as `hash_study` takes them."""
    pieces: list[bytes] = []
    _add_pieces(values, pieces)
    return sha256(b"\0".join(pieces))


def _add_pieces(value: Any, pieces: list[bytes]) -> None:
    """Append a value as bytes that tell it from every other one."""
    if isinstance(value, np.ndarray):
        pieces += f"array {value.dtype} {value.shape}".encode(), np.ascontiguousarray(value).tobytes()
    elif isinstance(value, Enum):
        pieces.append(f"{type(value).__name__}.{value.name}".encode())
    elif is_dataclass(value) or isinstance(value, Mapping):
        # of a dataclass, only fields that are not derived from others
        pairs = (
            value.items()
            if isinstance(value, Mapping)
            else ((f.name, getattr(value, f.name)) for f in fields(value) if f.init)
        )
        pieces.append(b"dict" if isinstance(value, dict) else type(value).__name__.encode())
        _add_pieces(tuple(pairs), pieces)
    elif isinstance(value, tuple | list):
        pieces.append(f"list {len(value)}".encode())
        for item in value:
            _add_pieces(item, pieces)
    elif isinstance(value, str | int | float | None):
        pieces.append(repr(value).encode())
    else:
        raise TypeError(f"a study holds {type(value).__name__}, which has no place in its content")


TARGET = "target"  # code of the warning
TRIED = 8  # candidates that are simulated again: one block of the vectorised loop


def other_targets(journal: Journal, study: Searched, objective: Objective) -> tuple[Finding, ...]:
    """Warning that a resumed run may end differently from an uninterrupted one; empty if this target gives equal bits.

    The best candidate so far and some others are simulated again by the objective of the search, on threads of
    this process, and compared bit for bit. The journal's last session belongs to this process.
    """
    records = journal.targets
    if study.same_bits and study.method.is_evolution:  # which rounds equally on all processors
        records = [{name: text for name, text in record.items() if name in package_versions()} for record in records]
    text = other_bits(
        differing(records),
        "the best candidates",
        *_best_again(journal, objective),
    )
    cure = "the run may end differently from an uninterrupted one; resume it on the machine where it began"
    return (make_finding(TARGET, study.title, f"{text}: {cure}."),) if text else ()


def differing(targets: Sequence[Mapping[str, str]]) -> str:
    """Differences of the last target from each earlier one, as a part of a sentence, or ""."""
    said: dict[str, str] = {}
    for number, before in enumerate(targets[:-1], 1):
        if (text := differences(before, targets[-1])) and text not in said:
            said[text] = "begun" if number == 1 else f"resumed as session {number}"
    return "; ".join(f"{since} with {text}" for text, since in said.items())


def other_bits(differing: str, candidates: str, recorded: float, recomputed: float) -> str:
    """Description of all differences, or "": those of `differing`, and the bits of a candidate.

    `recorded` and `recomputed` are the objectives of one candidate in the journal and here: of the first one that
    differs, if any does.
    """
    if recorded != recomputed:
        change = f"{candidates}, simulated again, have other bits here, {recomputed!r} in place of {recorded!r}"
        return f"{differing}; {change}" if differing else change
    if differing:
        return f"{differing}; {candidates}, simulated again, have the same bits here, but others may not"
    return ""


def _best_again(journal: Journal, objective: Objective) -> tuple[float, float]:
    """Objective of the best candidate in the journal and here; or of another candidate if only that differs."""
    trials, costs = journal.best_step()
    candidates = np.argsort(costs, kind="stable")[:TRIED]
    candidates = candidates[np.isfinite(costs[candidates])]
    if not len(candidates):
        return 0.0, 0.0
    again = objective.costs(np.ascontiguousarray(trials[candidates])).costs
    which = int(np.argmax(again != costs[candidates]))
    return float(costs[candidates][which]), float(again[which])


# Changes of a run's files since it was begun.

MOST = 3  # keys that a sentence names


def check_files(journal: Journal, as_begun: bool) -> None:
    """Refuse to resume if the files have changed since the run began; with `as_begun`, only the copies are checked.

    The `StudyError` names the changed file and, for the study, the changed keys.
    """
    about, inputs = journal.about, journal.inputs
    if inputs and about.get("before") and fingerprint(journal.folder / inputs[0].name) == about["before"]:
        # a crash came between the journal's note of more generations and the file
        with write_set(journal.folder):
            write_text(journal.folder / inputs[0].name, about.get("study", ""))
    for i, item in enumerate(inputs):
        path = journal.folder / item.name
        if (now := fingerprint(path)) != item.copy:
            what = _what(about.get("study", ""), path) if i == 0 else ""
            raise StudyError(
                f"{path} {'is missing' if not now else f'has been changed since the run was begun{what}'}; bring it "
                "back as it was, or begin a new run."
            )
    if not as_begun:
        again = f"go on with the copy as it was: `{command('resume', journal.folder, '--as-begun')}`"
        check_origins(journal.folder, inputs, about.get("given", ""), again)


def check_origins(folder: Path, inputs: Sequence[Input], study_text: str, cure: str) -> None:
    """Raise `StudyError` if an original file of a run exists and has changed since.

    `inputs`: inputs of the run in `folder`; `study_text`: text of its study; `cure`: remedy other than to begin a new
    run.
    """
    for i, item in enumerate(inputs):
        path = Path(item.origin)
        if (now := fingerprint(path)) and now != item.original:
            what = _what(study_text, path) if i == 0 else ""
            raise StudyError(
                f"{path} has been changed since the run in {folder} was begun{what}; begin a new run for it, or {cure}."
            )


def _what(before: str, path: Path) -> str:
    """Keys of a study file that have changed, in parentheses."""
    try:
        old, new = (dict(_leaves(tomllib.loads(text))) for text in (before, read_text(path, LARGEST_TOML)))
    except (InputError, ValueError, RecursionError):
        return ""
    keys = [key for key in {**old, **new} if old.get(key) != new.get(key)]
    if not keys:
        return " (comments or spaces)"
    shown = [f"{key}: {_text(old.get(key))} -> {_text(new.get(key))}" for key in keys[:MOST]]
    return f" ({'; '.join(shown)}{'; ...' if len(keys) > MOST else ''})"


def _leaves(value: Any, key: str = "") -> list[tuple[str, Any]]:
    """Values of nested tables by dotted key."""
    if isinstance(value, dict):
        return [leaf for name, item in value.items() for leaf in _leaves(item, f"{key}.{name}" if key else name)]
    if isinstance(value, list) and any(isinstance(item, dict) for item in value):
        return [leaf for i, item in enumerate(value) for leaf in _leaves(item, f"{key}[{i + 1}]")]
    return [(key, value)]


def _text(value: Any) -> str:
    text = "absent" if value is None else f"{value!r}".replace("'", '"')
    return text if len(text) <= 40 else text[:37] + "..."
