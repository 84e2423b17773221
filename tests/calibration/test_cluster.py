"""A Dask cluster gives the same bits; what is wrong with one is told in a sentence."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from commonrail.calibration import cluster as cluster_module
from commonrail.calibration import workers as module
from commonrail.calibration.objective import Objective
from commonrail.calibration.worker_pool import Limits
from commonrail.calibration.workers import Workers
from commonrail.errors import ConfigurationError, InputError, StudyError
from commonrail.files.study_file import load_study
from commonrail.kinds import Role, of_role
from tests.calibration.misbehaving import Misbehaving
from tests.waiting import PATIENCE, wait_until

CASE = Path(__file__).parents[2] / "cases" / "paper" / "study.toml"
CANDIDATES = 45
MARKED = 20
# A piece of these takes some ms: two seconds without an answer is a worker that hangs, or a machine with much other
# work; what is taken for hanging by mistake is simulated once more.
HASTY = Limits(failures=10_000, least=2.0)
DISTRIBUTED = "distributed is not installed: pip install 'commonrail[cluster]'"

Floats = NDArray[np.float64]

pytestmark = pytest.mark.process


@pytest.fixture(scope="module")
def objective() -> Objective:
    study = load_study(CASE)
    return Objective(study.injector, study.space.names, of_role(study.data, Role.FIT), study.time_step, threads=1)


@pytest.fixture(scope="module")
def population(objective: Objective) -> Floats:
    own = np.array([objective.injector.values[name] for name in objective.names])
    found: Floats = own * np.random.default_rng(1).uniform(0.8, 1.25, (CANDIDATES, len(own)))
    return found


@pytest.fixture(scope="module")
def local() -> Iterator[Workers]:
    pytest.importorskip("distributed", reason=DISTRIBUTED)
    with Workers.cluster("local", 2) as workers:
        yield workers


@pytest.fixture
def many_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    """A population that lasts some ms is cut up too."""
    monkeypatch.setattr(module, "SHORTEST", 1e-9)


@pytest.mark.usefixtures("many_pieces")
def test_a_local_cluster_gives_the_same_bits(local: Workers, objective: Objective, population: Floats) -> None:
    assert local.backend.count == 2
    spread = local.spread(objective)
    scores = spread.costs(population)
    assert scores.costs.tobytes() == objective.costs(population).costs.tobytes()
    assert scores.simulations == CANDIDATES
    assert spread.residuals(population[:19]).tobytes() == objective.residuals(population[:19]).tobytes()


@pytest.mark.usefixtures("many_pieces")
def test_a_worker_of_a_cluster_that_dies_leaves_no_trace(
    local: Workers, objective: Objective, population: Floats, tmp_path: Path
) -> None:
    bad = Misbehaving(objective, population[MARKED, 0], "die", 1, tmp_path)
    assert local.spread(bad).costs(population).costs.tobytes() == objective.costs(population).costs.tobytes()
    assert len(list(tmp_path.iterdir())) >= 2  # it did die, and was asked again


@pytest.mark.usefixtures("many_pieces")
def test_what_the_objective_refuses_is_refused_in_its_own_words(
    local: Workers, objective: Objective, population: Floats, tmp_path: Path
) -> None:
    bad = Misbehaving(objective, population[MARKED, 0], "refuse", 99, tmp_path)
    with pytest.raises(ConfigurationError, match=r"^This cannot be simulated\.$"):
        local.spread(bad).costs(population)


@pytest.mark.slow
@pytest.mark.usefixtures("many_pieces")
def test_a_worker_of_a_cluster_that_hangs_is_started_anew(
    local: Workers, objective: Objective, population: Floats, tmp_path: Path
) -> None:
    bad = Misbehaving(objective, population[MARKED, 0], "hang", 1, tmp_path)
    spread = Workers(local.backend, HASTY).spread(bad)
    assert spread.costs(population).costs.tobytes() == objective.costs(population).costs.tobytes()


@pytest.mark.slow
@pytest.mark.usefixtures("many_pieces")
def test_a_piece_that_always_kills_its_worker_ends_the_run(
    objective: Objective, population: Floats, tmp_path: Path
) -> None:
    pytest.importorskip("distributed", reason=DISTRIBUTED)
    bad = Misbehaving(objective, population[MARKED, 0], "die", 99, tmp_path)
    limits = Limits(failures=1)
    with (
        Workers.cluster("local", 2, limits) as workers,
        pytest.raises(StudyError, match=r"lost 1 times \(the worker met KilledWorker"),
    ):
        workers.spread(bad).costs(population)


@contextmanager
def scheduler(folder: Path, workers: int = 0) -> Iterator[str]:
    """Address of a scheduler in a process of its own, and of so many workers that nobody can start anew."""
    contact = folder / "scheduler.json"
    common = ["--no-dashboard", "--scheduler-file", str(contact)]
    dask = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", *common]
    plain = [sys.executable, "-m", "distributed.cli.dask_worker", "--no-nanny", "--nthreads", "1", *common]
    started = [subprocess.Popen(dask, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)]
    try:
        wait_until(lambda: contact.exists() and contact.stat().st_size > 0, "a scheduler says its address")
        address = json.loads(contact.read_text(encoding="utf-8"))["address"]
        for _ in range(workers):
            started.append(subprocess.Popen(plain, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))
        if workers:
            with distributed_client(address) as client:
                client.wait_for_workers(workers, timeout=PATIENCE)
        yield str(address)
    finally:
        for process in started:
            process.kill()
            process.wait()


def distributed_client(address: str) -> Any:
    from distributed import Client

    return Client(address, timeout=PATIENCE, set_as_default=False)


@pytest.mark.slow
@pytest.mark.usefixtures("many_pieces")
def test_a_cluster_by_its_address_goes_on_without_a_worker_that_hangs_and_cannot_be_restarted(
    objective: Objective, population: Floats, tmp_path: Path
) -> None:
    pytest.importorskip("distributed", reason=DISTRIBUTED)
    expected = objective.costs(population).costs.tobytes()
    with scheduler(tmp_path, 2) as address, Workers.cluster(address, limits=HASTY) as workers:
        assert workers.backend.count == 2
        assert workers.spread(objective).costs(population).costs.tobytes() == expected
        (tmp_path / "counted").mkdir()
        bad = Misbehaving(objective, population[MARKED, 0], "hang", 1, tmp_path / "counted")
        assert workers.spread(bad).costs(population).costs.tobytes() == expected
        assert workers.backend.count == 1


@pytest.mark.slow
def test_a_scheduler_that_goes_away_is_told_of(objective: Objective, population: Floats, tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason=DISTRIBUTED)
    with scheduler(tmp_path, 1) as address:
        workers = Workers.cluster(address)
        spread = workers.spread(objective)
    with pytest.raises(StudyError, match=f"The connection to the cluster {address} is broken"):
        spread.costs(population)
    workers.close()


@pytest.mark.slow
def test_a_cluster_without_workers_is_told_of(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason=DISTRIBUTED)
    monkeypatch.setattr(cluster_module, "APPEAR", 1.0)
    with (
        scheduler(tmp_path) as address,
        pytest.raises(StudyError, match=f"has had no worker for 1 s; start some with `dask worker {address}`"),
    ):
        Workers.cluster(address)


def test_a_missing_package_is_told_of(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"install it with `pip install 'commonrail\[cluster\]'`"):
        Workers.cluster("local")


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "foo://here"])
def test_an_address_without_a_scheduler_is_refused(monkeypatch: pytest.MonkeyPatch, address: str) -> None:
    pytest.importorskip("distributed", reason=DISTRIBUTED)
    monkeypatch.setattr(cluster_module, "CONNECT", 0.5)
    with pytest.raises(InputError, match=f"There is no Dask scheduler at {address} "):
        Workers.cluster(address)


@pytest.mark.parametrize("address", ["here", "", "lokal", "a b", "host:port"])
def test_what_is_no_address_is_refused_at_once(address: str) -> None:
    pytest.importorskip("distributed", reason=DISTRIBUTED)
    with pytest.raises(InputError, match=f'"{address}" is no address of a scheduler; give one as "tcp://host:port"'):
        Workers.cluster(address)


def test_a_number_of_workers_that_makes_no_sense_is_refused() -> None:
    pytest.importorskip("distributed", reason=DISTRIBUTED)
    with pytest.raises(ConfigurationError, match=r"must lie between 1 and \d+, 8 for each processor .*, not 0"):
        Workers.cluster("local", 0)
