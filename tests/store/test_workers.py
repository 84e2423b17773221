"""A whole run gives the same bytes whoever simulates, and though a worker is killed in the middle of it."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import pytest

from commonrail.calibration import workers as module
from commonrail.calibration.search import Progress
from commonrail.calibration.study import Study
from commonrail.calibration.worker_pool import Limits, WorkerPool
from commonrail.calibration.workers import Workers
from commonrail.files.study_file import load_study
from commonrail.store.run import Listener, calibrate_into, resume
from tests.store.conftest import GENERATIONS, stopped_run, timeless

CASE = Path(__file__).resolve().parents[2] / "cases" / "paper" / "study.toml"
HASTY = Limits(patience=50.0, least=5.0)
KILLED_AFTER = 20  # generations


@pytest.fixture(scope="module")
def study() -> Study:
    """The paper's: 50 members, seven blocks of lanes, 70 generations."""
    return load_study(CASE)


@pytest.fixture(scope="module")
def alone(study: Study, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """What one process with one thread finds."""
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


def pids_of(workers: Workers) -> list[int]:
    if isinstance(workers.backend, WorkerPool):
        return workers.backend.pids
    from commonrail.calibration.cluster import Cluster

    assert isinstance(workers.backend, Cluster)
    found: dict[str, int] = workers.backend._client.run(os.getpid)
    return list(found.values())


def cluster() -> AbstractContextManager[Workers]:
    pytest.importorskip("distributed", reason="distributed is not installed: pip install 'commonrail[cluster]'")
    return Workers.cluster("local", 2, HASTY)


@pytest.mark.parametrize(
    "crew",
    [
        pytest.param(lambda: Workers.processes(1, HASTY), id="1 process"),
        pytest.param(lambda: Workers.processes(2, HASTY), id="2 processes"),
        pytest.param(lambda: Workers.processes(4, HASTY), id="4 processes"),
        pytest.param(cluster, id="local cluster"),
    ],
)
def test_the_same_bytes_though_a_worker_is_killed(
    study: Study, alone: bytes, tmp_path: Path, crew: Callable[[], AbstractContextManager[Workers]]
) -> None:
    with crew() as workers:
        listener, killed = killer(lambda: pids_of(workers))
        calibrate_into(tmp_path / "run", study, threads=1, workers=workers, listener=listener)
        assert killed
        assert killed[0] not in pids_of(workers)
    assert timeless(tmp_path / "run") == alone


def test_workers_that_are_lost_for_good_leave_a_run_to_go_on_with(tmp_path: Path, whole: object) -> None:
    study = load_study(CASE)
    run = stopped_run(tmp_path / "run", study, 1 + GENERATIONS)
    with Workers.processes(1, HASTY) as workers:
        resume(run, threads=1, workers=workers)
    calibrate_into(tmp_path / "whole", study, threads=2)
    assert timeless(run) == timeless(tmp_path / "whole")
