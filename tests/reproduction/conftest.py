"""Two repetitions on the virtual test bench, run once."""

from __future__ import annotations

import functools
from dataclasses import replace

import pytest

from commonrail.analysis.virtual_bench import Bench
from commonrail.files.injector_file import load_injector
from commonrail.files.truth_file import load_truth
from commonrail.kinds import RateData
from commonrail.reproduction import paper, repetition
from commonrail.reproduction.paper import Configuration
from commonrail.reproduction.repetition import measure
from commonrail.reproduction.run import Reproduction, reproduce


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
    monkeypatch.setattr(repetition, "measure", lambda _, seed: measured(seed))
    return bench("virtual-lino-2016")


@pytest.fixture(scope="session")
def done() -> Reproduction:
    """Two repetitions on two threads."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(repetition, "measure", lambda _, seed: measured(seed))
        return reproduce(bench("virtual-lino-2016"), (1, 2), threads=2)
