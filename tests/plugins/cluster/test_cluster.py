"""A Dask cluster: reached by its address, and what is wrong with one is told in a sentence."""

from __future__ import annotations

import gc
import os
import signal
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest

from commonrail.base.errors import InputError, StudyError
from commonrail.plugins import cluster as cluster_module
from commonrail.plugins import cluster as link_module
from commonrail.workers.pool import Limits
from commonrail.workers.task import pack
from commonrail.workers.workers import Workers
from tests.robustness.attack.cluster import silent_listener
from tests.robustness.attack.dask_cluster import Member, certificates, dask_cluster
from tests.workers.crews import NO_DASK, Deed, Deeds, cluster, expected, sines, tasks

pytestmark = pytest.mark.process

MANY = [Deed(number) for number in range(20)]
# An answer takes some ms: so long without one is a worker that hangs, or a machine with much other work; what is taken
# for hanging by mistake is done once more.
HASTY = Limits(failures=10_000)
SHORT = 20.0


@pytest.mark.slow
def test_a_cluster_by_its_address_goes_on_without_a_worker_that_hangs_and_cannot_be_restarted(tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason=NO_DASK)
    package = pack(Deeds(tmp_path))
    with dask_cluster(tmp_path, [Member()] * 2) as address, Workers.cluster(address, limits=HASTY) as workers:
        assert workers.backend.count == 2
        assert sines(workers.run(tasks(package, MANY))) == expected(MANY)
        hanging = [*MANY, Deed(99, "hang")]
        assert sines(workers.run(tasks(package, hanging, SHORT))) == expected(hanging)
        assert workers.backend.count == 1


@pytest.mark.slow
def test_a_scheduler_that_goes_away_is_told_of(tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason=NO_DASK)
    with dask_cluster(tmp_path, [Member()]) as address:
        workers = Workers.cluster(address)
    with pytest.raises(StudyError, match=f"connection .*{address} .*broken"):
        list(workers.run(tasks(pack(Deeds(tmp_path)), MANY)))
    workers.close()


@pytest.mark.slow
def test_a_cluster_without_workers_is_told_of(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason=NO_DASK)
    monkeypatch.setattr(cluster_module, "APPEAR", 1.0)
    with (
        dask_cluster(tmp_path) as address,
        pytest.raises(StudyError, match=f"no worker .*1 s.*{address}`"),
    ):
        Workers.cluster(address)


def test_a_missing_package_is_told_of(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"'commonrail\[cluster\]'"):
        Workers.cluster("local")


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "foo://here"])
def test_an_address_without_a_scheduler_is_refused(monkeypatch: pytest.MonkeyPatch, address: str) -> None:
    pytest.importorskip("distributed", reason=NO_DASK)
    monkeypatch.setattr(link_module, "CONNECT", 0.5)
    with pytest.raises(InputError, match=f"no Dask .*{address} "):
        Workers.cluster(address)


@pytest.mark.parametrize("address", ["here", "", "lokal", "a b", "host:port"])
def test_what_is_no_address_is_refused_at_once(address: str) -> None:
    pytest.importorskip("distributed", reason=NO_DASK)
    with pytest.raises(InputError, match=f'^"{address}" .*"tcp://host:port"'):
        Workers.cluster(address)


@pytest.mark.parametrize("package", ["distributed", "cryptography"])
def test_what_a_cluster_here_needs_is_named(monkeypatch: pytest.MonkeyPatch, package: str) -> None:
    pytest.importorskip("distributed", reason=NO_DASK)
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(InputError, match=rf"package {package}, .*'commonrail\[cluster\]'"):
        Workers.cluster("local")


def test_a_scheduler_that_accepts_and_says_nothing_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed", reason=NO_DASK)
    monkeypatch.setattr(link_module, "CONNECT", 0.1)
    with (
        silent_listener() as port,
        pytest.raises(InputError, match=f"tcp://127.0.0.1:{port} .*no answer"),
    ):
        Workers.cluster(f"tcp://127.0.0.1:{port}")


def test_the_folder_of_a_cluster_here_is_private_and_ends_with_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with cluster(1):
        (folder,) = tmp_path.glob("commonrail-*")
        assert list(folder.iterdir())  # of the workers
        assert folder.stat().st_mode & 0o777 == 0o700
    assert not folder.exists()


def test_no_garbage_is_collected_while_dask_starts_a_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    """An abandoned client that was collected there waited for ever for the lock that its own thread held."""
    utils = pytest.importorskip("distributed.utils", reason=NO_DASK)
    collecting: list[bool] = []
    for name in ("_start_unlocked", "_stop_unlocked"):
        call = getattr(utils.LoopRunner, name)

        def watched(self: object, *given: object, call: Callable[..., None] = call) -> None:
            collecting.append(gc.isenabled())
            call(self, *given)

        monkeypatch.setattr(utils.LoopRunner, name, watched)
    with cluster(1):
        assert gc.isenabled()
    assert len(collecting) >= 2
    assert not any(collecting)
    assert gc.isenabled()


def test_a_worker_that_dies_is_waited_for_beyond_dasks_patience(tmp_path: Path) -> None:
    """On a busy machine another one takes longer to start than Dask waits, which then starts none at all."""
    dask = pytest.importorskip("dask", reason=NO_DASK)
    with dask.config.set({"distributed.deploy.lost-worker-timeout": "1 ms"}), cluster(1) as workers:
        last = [Deed(1, "die")]
        assert sines(workers.run(tasks(pack(Deeds(tmp_path)), last))) == expected(last)


@pytest.mark.slow
def test_a_scheduler_that_is_halted_in_the_middle_is_told_of(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason=NO_DASK)
    package = pack(Deeds(tmp_path))
    with dask_cluster(tmp_path, [Member()]) as address, Workers.cluster(address) as workers:
        assert sines(workers.run(tasks(package, MANY))) == expected(MANY)
        process = scheduler_of(workers)
        monkeypatch.setattr(link_module, "ANSWER", 0.2)
        monkeypatch.setattr(link_module, "LEAVE", 0.2)
        os.kill(process, signal.SIGSTOP)
        with pytest.raises(StudyError, match=f"cluster {address} .*no answer"):
            list(workers.run(tasks(package, MANY)))


def scheduler_of(workers: Workers) -> int:
    """Process number of the scheduler."""
    from commonrail.plugins.cluster import Cluster

    assert isinstance(workers.backend, Cluster)
    return int(workers.backend._link.ask(lambda client: client.run_on_scheduler(os.getpid)))


def configured(environment: dict[str, str]) -> dict[str, str]:
    """Dask's configuration by its keys, from an environment."""
    keys = {name: name.removeprefix("DASK_").lower().replace("__", ".").replace("_", "-") for name in environment}
    return {keys[name]: value for name, value in environment.items()}


@pytest.mark.slow
def test_a_cluster_elsewhere_is_entered_with_its_certificate_alone(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    dask = pytest.importorskip("dask", reason=NO_DASK)
    pytest.importorskip("cryptography", reason=NO_DASK)
    ours = certificates(tmp_path / "ours")
    monkeypatch.setattr(link_module, "CONNECT", 2.0)
    with dask_cluster(tmp_path, [Member()], ours) as address:
        assert address.startswith("tls://")
        for said, words in ((certificates(tmp_path / "theirs"), "certificate|CERTIFICATE"), ({}, "TLS")):
            with (
                dask.config.set(configured(said)),
                pytest.raises(InputError, match=f"no Dask .*{address} .*({words})"),
            ):
                Workers.cluster(address)
        with dask.config.set(configured(ours)), Workers.cluster(address) as workers:
            assert sines(workers.run(tasks(pack(Deeds(tmp_path)), MANY))) == expected(MANY)


@pytest.mark.parametrize(
    ("address", "is_safe"),
    [
        ("tls://head:8786", True),
        ("tcp://127.0.0.1:8786", True),
        ("localhost:8786", True),
        ("tcp://[::1]:8786", True),
        ("tcp://head:8786", False),
        ("head:8786", False),
        ("ws://head:8786", False),
        ("tcp://127.0.0.1.evil.org:8786", False),
    ],
)
def test_an_address_where_others_listen_in_is_known(address: str, is_safe: bool) -> None:
    assert bool(link_module._HERE.fullmatch(address)) == is_safe
