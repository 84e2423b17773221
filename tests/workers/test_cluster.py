"""A Dask cluster: reached by its address, and what is wrong with one is told in a sentence."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from commonrail.errors import InputError, StudyError
from commonrail.workers import cluster as cluster_module
from commonrail.workers import link as link_module
from commonrail.workers.limits import Limits
from commonrail.workers.task import pack
from commonrail.workers.workers import Workers
from tests.waiting import PATIENCE, wait_until
from tests.workers.crews import NO_DASK, Deed, Deeds, expected, sines, tasks

pytestmark = pytest.mark.process

MANY = [Deed(number) for number in range(20)]
# An answer takes some ms: so long without one is a worker that hangs, or a machine with much other work; what is taken
# for hanging by mistake is done once more.
HASTY = Limits(failures=10_000)
SHORT = 20.0


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
def test_a_cluster_by_its_address_goes_on_without_a_worker_that_hangs_and_cannot_be_restarted(tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason=NO_DASK)
    package = pack(Deeds(tmp_path))
    with scheduler(tmp_path, 2) as address, Workers.cluster(address, limits=HASTY) as workers:
        assert workers.backend.count == 2
        assert sines(workers.run(tasks(package, MANY))) == expected(MANY)
        hanging = [*MANY, Deed(99, "hang")]
        assert sines(workers.run(tasks(package, hanging, SHORT))) == expected(hanging)
        assert workers.backend.count == 1


@pytest.mark.slow
def test_a_scheduler_that_goes_away_is_told_of(tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason=NO_DASK)
    with scheduler(tmp_path, 1) as address:
        workers = Workers.cluster(address)
    with pytest.raises(StudyError, match=f"The connection to the cluster {address} is broken"):
        list(workers.run(tasks(pack(Deeds(tmp_path)), MANY)))
    workers.close()


@pytest.mark.slow
def test_a_cluster_without_workers_is_told_of(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason=NO_DASK)
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
    pytest.importorskip("distributed", reason=NO_DASK)
    monkeypatch.setattr(link_module, "CONNECT", 0.5)
    with pytest.raises(InputError, match=f"There is no Dask scheduler at {address} "):
        Workers.cluster(address)


@pytest.mark.parametrize("address", ["here", "", "lokal", "a b", "host:port"])
def test_what_is_no_address_is_refused_at_once(address: str) -> None:
    pytest.importorskip("distributed", reason=NO_DASK)
    with pytest.raises(InputError, match=f'"{address}" is no address of a scheduler; give one as "tcp://host:port"'):
        Workers.cluster(address)
