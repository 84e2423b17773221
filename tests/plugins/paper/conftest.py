"""Two repetitions on the virtual test bench, run once."""

from __future__ import annotations

import functools
from dataclasses import replace
from typing import Any

import pytest

from commonrail.data.curves.data import RateData
from commonrail.plugins.paper import run
from commonrail.plugins.paper import study as paper
from commonrail.plugins.paper.bench import Bench
from commonrail.plugins.paper.bench_file import load_truth
from commonrail.plugins.paper.file import reproduction_record
from commonrail.plugins.paper.run import Reproduction, measure, reproduce
from commonrail.plugins.paper.study import Configuration
from commonrail.readers.injector import load_injector
from tests.cli.conftest import command, study  # noqa: F401
from tests.readers.conftest import injector_file, study_file  # noqa: F401


def bench(truth: str) -> Bench:
    """Bench of a packaged truth, with two steps to a sample: all its candidates bear that, and it saves a third."""
    declared = load_truth(truth)
    return Bench(declared, load_injector(declared.injector), 1.5e-6)


def shorten(patch: pytest.MonkeyPatch) -> None:
    """Give each search of a repetition a tenth of its generations: for what does not ask how good its end is."""
    table3 = {Configuration(c.generations // 10, c.members): js for c, js in paper.TABLE3.items()}
    best = Configuration(paper.BEST.generations // 10, paper.BEST.members)
    rigid = replace(paper.RIGID_FIT, generations=paper.RIGID_FIT.generations // 10)
    for name, value in {"TABLE3": table3, "CONFIGURATIONS": tuple(table3), "BEST": best, "RIGID_FIT": rigid}.items():
        patch.setattr(paper, name, value)


@functools.cache
def measured(seed: int) -> tuple[RateData, ...]:
    """Curves of the virtual test bench, simulated once: they depend on their arguments alone, as another test shows."""
    return measure(bench("virtual-lino-2016"), seed)


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> Bench:
    """The virtual test bench with short searches, and with curves that are simulated once."""
    shorten(monkeypatch)
    monkeypatch.setattr(run, "measure", lambda _, seed: measured(seed))
    return bench("virtual-lino-2016")


@pytest.fixture(scope="session")
def done() -> Reproduction:
    """Two repetitions on two threads."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run, "measure", lambda _, seed: measured(seed))
        return reproduce(bench("virtual-lino-2016"), (1, 2), threads=2)


@pytest.fixture(scope="session")
def record(done: Reproduction) -> dict[str, Any]:
    """Their record."""
    return reproduction_record(done)
