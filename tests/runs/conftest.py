"""A small study with everything that a run keeps, and its run that was never stopped."""

from __future__ import annotations

import copy
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import pytest

from commonrail.calibration.identifiability import Identified, identify
from commonrail.calibration.run import Calibration
from commonrail.calibration.search import Progress
from commonrail.calibration.study import Study
from commonrail.calibration.study_file import load_study
from commonrail.plugins.new.study import write_new
from commonrail.runs.fingerprint import hash_study
from commonrail.runs.fit import Listener, calibrate_into
from tests.readers.conftest import injector_file  # noqa: F401

GENERATIONS, REFINEMENTS = 5, 3
_SMALL = {"members = 24": "members = 8", "generations = 30": f"generations = {GENERATIONS}"}
_SMALL["polish = 3"] = f"polish = {REFINEMENTS}\npolish_iterations = 2"  # one from a member, two hops


class Stopped(BaseException):
    """Stand-in for the end of a process: no handler of the project's takes it."""


def write_small(folder: Path) -> Path:
    """Write the study of ``commonrail new`` with a short search."""
    write_new(folder)
    study = folder / "study.toml"
    text = study.read_text(encoding="utf-8")
    for old, new in _SMALL.items():
        assert old in text
        text = text.replace(old, new)
    study.write_text(text, encoding="utf-8")
    return study


def timeless(run: Path, name: str = "result.json") -> bytes:
    """A run's record without what depends on the clock."""
    content = (run / name).read_bytes()
    found, count = re.subn(rb',\n "clock": \{[^}]*\}', b"", content)
    assert count == 1
    return found


def stop_after(steps: int) -> Listener:
    """A listener that ends the process after so many generations and refinements."""
    left = iter(range(steps - 1))

    def progress(_: Progress) -> None:
        if next(left, None) is None:
            raise Stopped

    return Listener(progress)


def stopped_run(folder: Path, study: Study, steps: int) -> Path:
    """A run that was killed after so many steps."""
    with pytest.raises(Stopped):
        calibrate_into(folder, study, threads=1, listener=stop_after(steps))
    return folder


_JUDGED: dict[tuple[object, ...], Identified] = {}


def _judged_before(calibration: Calibration, threads: int | None = None, *, starts: int = 1) -> Identified:
    """As `identify`, once for the same study, threads, starts, best values and other optima."""
    ends = tuple((end.x.tobytes(), end.cost) for end in calibration.ends)
    key = (hash_study(calibration.study), threads, starts, tuple(calibration.best.items()), calibration.cost, ends)
    if key not in _JUDGED:
        _JUDGED[key] = identify(calibration, threads, starts=starts)
    return copy.deepcopy(_JUDGED[key])


@contextmanager
def judged_before() -> Iterator[None]:
    """Judgements of runs that end alike are computed once: they take as long as the short searches of these tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("commonrail.runs.fit.identify", _judged_before)
        yield


@pytest.fixture(autouse=True, scope="module")
def _judged_once() -> Iterator[None]:
    with judged_before():
        yield


class Whole(NamedTuple):
    """A study's file and its run that was never stopped."""

    study: Path
    run: Path


@pytest.fixture(scope="session")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Whole:
    """The run to compare with."""
    folder = tmp_path_factory.mktemp("store")
    study = write_small(folder / "small")
    with judged_before():
        calibrate_into(folder / "run", load_study(study), threads=1)
    return Whole(study, folder / "run")


@pytest.fixture
def study_file(tmp_path: Path) -> Path:
    """The study's file, to be changed."""
    return write_small(tmp_path / "small")


Stop = Callable[[int], Path]


@pytest.fixture
def stopped(tmp_path: Path, study_file: Path) -> Stop:
    """Makes a run that was killed after so many steps."""
    return lambda steps: stopped_run(tmp_path / "run", load_study(study_file), steps)
