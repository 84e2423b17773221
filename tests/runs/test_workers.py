"""A whole run gives the same bytes whoever simulates, and though a worker is killed in the middle of it."""

from __future__ import annotations

import os
import re
import shutil
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from commonrail.calibration import distributed_objective as module
from commonrail.calibration.search import Progress
from commonrail.calibration.study import Study
from commonrail.calibration.study_file import load_study
from commonrail.runs.fit import Listener, calibrate_into, resume
from tests.runs.conftest import GENERATIONS, stopped_run, timeless
from tests.workers.crews import Crew, cluster, pids_of, processes

CASE = Path(__file__).resolve().parents[2] / "cases" / "paper"
GENERATIONS_OF_ALL, KILLED_AFTER = 20, 6
pytestmark = [pytest.mark.process, pytest.mark.usefixtures("forked_workers")]


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Study:
    """The paper's with fewer generations: 50 members, seven blocks of lanes."""
    case = Path(shutil.copytree(CASE, tmp_path_factory.mktemp("case") / "paper"))
    text = (case / "study.toml").read_text(encoding="utf-8")
    short = re.sub(r"generations = 70\b", f"generations = {GENERATIONS_OF_ALL}", text)
    assert short != text
    (case / "study.toml").write_text(short, encoding="utf-8")
    return load_study(case / "study.toml")


@pytest.fixture(scope="module")
def alone(study: Study, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Result of one process with one thread."""
    run = tmp_path_factory.mktemp("alone") / "run"
    calibrate_into(run, study, threads=1)
    return timeless(run)


@pytest.fixture(autouse=True)
def _many_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    """A generation, which lasts some ms, is cut up too."""
    monkeypatch.setattr(module, "SHORTEST", 1e-9)


def killer(pids: Callable[[], list[int]]) -> tuple[Listener, list[int]]:
    """A listener that kills a worker in the middle of a run, and whom it killed."""
    killed: list[int] = []

    def progress(p: Progress) -> None:
        if p.generation == KILLED_AFTER and not killed:
            killed.append(pids()[0])
            os.kill(killed[0], signal.SIGKILL)

    return Listener(progress), killed


@pytest.mark.parametrize(
    ("crew", "count"),
    [(processes, 2), (cluster, 2), *(pytest.param(processes, n, marks=pytest.mark.slow) for n in (1, 4))],
)
def test_the_same_bytes_though_a_worker_is_killed(
    study: Study, alone: bytes, tmp_path: Path, crew: Crew, count: int
) -> None:
    with crew(count) as workers:
        listener, killed = killer(lambda: pids_of(workers))
        calibrate_into(tmp_path / "run", study, threads=1, workers=workers, listener=listener)
        assert killed
        assert killed[0] not in pids_of(workers)
    assert timeless(tmp_path / "run") == alone


def test_workers_that_are_lost_for_good_leave_a_run_to_go_on_with(study: Study, alone: bytes, tmp_path: Path) -> None:
    run = stopped_run(tmp_path / "run", study, 1 + GENERATIONS)
    with processes(1) as workers:
        resume(run, threads=1, workers=workers)
    assert timeless(run) == alone
