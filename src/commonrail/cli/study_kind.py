"""Kinds of study other than injectors, registered in the group "studies" with their functions."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from commonrail.base import registry
from commonrail.base.errors import InputError

_FORMAT = re.compile(r"commonrail-(?P<name>.+)/\d+")


class RunOptions(NamedTuple):
    """Options of the command line for a search in a run folder."""

    seed: int | None = None  # None: seed of the file
    generations: int = 0  # additional generations
    as_begun: bool = False  # resume although files outside the folder have changed
    threads: int | None = None  # None: all processors
    workers: int | None = None  # number of processes that simulate
    cluster: str | None = None  # address of a cluster that simulates
    json: bool = False  # print one record


class StudyKind(NamedTuple):
    """Kind of study, registered as NAME: its file has the format "commonrail-NAME/1", a run folder keeps "NAME.toml".

    Attributes
    ----------
    resume : function of (Path, RunOptions)
        Resumes the run in a folder and prints its result.
    calibrate : function of (Path, Path or None, RunOptions), optional
        Fits the study of a file into a new run folder (None: an unused one in runs/) and prints its result. Without
        this function, the kind has its own verb.
    """

    resume: Callable[[Path, RunOptions], None]
    calibrate: Callable[[Path, Path | None, RunOptions], None] | None = None


def kind_of_study(path: Path) -> StudyKind | None:
    """Kind of the study in a file; None for that of an injector, and for what is no study."""
    from commonrail.readers.toml import read_toml

    try:
        match = _FORMAT.fullmatch(str(read_toml(path)[0].get("format", "")))
    except InputError:
        return None
    entry = registry.find("studies", match["name"]) if match and match["name"] != "study" else None
    return None if entry is None else entry.load()


def kind_of_run(folder: Path) -> StudyKind | None:
    """Kind of the study in a run folder; None for a study of an injector."""
    from commonrail.runs.journal import JOURNAL

    if not (folder / JOURNAL).is_file() or (folder / "study.toml").is_file():  # a study of an injector
        return None
    parts = registry.entries("studies").items()
    return next((entry.load() for name, entry in parts if (folder / f"{name}.toml").is_file()), None)
