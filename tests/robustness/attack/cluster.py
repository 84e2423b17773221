"""Attacks on clusters: on one of this machine from beside, on others by a scheduler or worker that misbehaves."""

from __future__ import annotations

import json
import multiprocessing
import os
import re
import shutil
import socket
import threading
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from http.client import HTTPException
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from commonrail.base.errors import CommonrailError
from commonrail.calibration import distributed_objective
from commonrail.calibration.study_file import load_study
from commonrail.plugins.cluster import Cluster
from commonrail.runs.fit import calibrate_into
from commonrail.workers.workers import Workers
from tests.robustness.attack.base import attack, command
from tests.robustness.attack.dask_cluster import Member, dask_cluster

CASE = Path(__file__).parents[3] / "cases" / "paper"
NOBODY = 65534  # another user
ENTERS = 10.0  # [s] Time for each try to enter; with the certificate it takes some ms.
PAGES = ("info/main/workers.html", "json/counts.json", "health", "metrics", "status")
LISTENS = "0A"  # state of a socket in /proc/net/tcp
LOOPBACK = ("0100007F", "00000000000000000000000001000000")

DIE = """
import os
from commonrail.workers import process
process.honest = honest = getattr(process, "honest", process.perform)  # Dask runs this twice
count = []

def perform(package, argument):
    count.append(1)
    if len(count) == 5:
        os.kill(os.getpid(), 9)
    return honest(package, argument)

process.perform = perform
"""
OLD = """
from commonrail import compile_target
compile_target.version = lambda name, honest=compile_target.version: "0.1" if name == "{package}" else honest(name)
"""


@attack()
def listens(folder: Path, times: int) -> str:
    """Every port of a local cluster listens on the loopback interface alone, and shows no page."""
    with Workers.cluster("local", 2) as workers:
        ports = listening({os.getpid(), *pids_of(workers)})
    open_to_all = [where for where, _ in ports if where not in LOOPBACK]
    if len(ports) < 3:
        return f"{len(ports)} ports found: a scheduler and two workers have more"
    return f"listens on {open_to_all}" if open_to_all else ""


@attack(few=0)
def entered(folder: Path, times: int) -> str:
    """Another user without the certificate of the run cannot enter a local cluster, at any of its ports."""
    here, there = multiprocessing.Pipe()
    process = multiprocessing.get_context("fork").Process(target=_enter, args=(there,), daemon=True)
    process.start()
    with Workers.cluster("local", 1) as workers:
        here.send([port for _, port in listening({os.getpid(), *pids_of(workers)})])
        found: list[str] = here.recv()
    process.kill()
    return ", ".join(found)


@attack(few=0)
def silent(folder: Path, times: int) -> str:
    """A cluster whose scheduler accepts and says nothing ends a command in time, with a sentence and status 2."""
    with silent_listener() as port:
        done = command(
            "calibrate", CASE / "study.toml", "--out", folder / "run", "--cluster", f"tcp://127.0.0.1:{port}"
        )
    if done.fault or done.status != 2 or "has given no answer within" not in done.said:
        return done.fault or f"status {done.status}: {done.said}"
    return "a run folder is left" if (folder / "run").exists() else ""


@attack(few=0)
def killed(folder: Path, times: int) -> str:
    """A worker of a cluster that is killed in the middle of a run changes no byte of the result."""
    with dask_cluster(folder, [Member(), Member(DIE)]) as address:
        same = _same_bytes(folder, address)
        left = _count(address)
    if left != 1:
        return f"{left} workers are left: none was killed"
    return "" if same else "other bytes"


@attack(few=0)
def other_software(folder: Path, times: int) -> str:
    """A worker of a cluster with another version, or with code for another processor, ends the run with an error."""
    members = {package: Member(OLD.format(package=package)) for package in ("commonrail", "numba", "llvmlite", "numpy")}
    generic = Member(environment={"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""})
    for name, member in {**members, "cpu": generic}.items():
        here = folder / name
        here.mkdir()
        with dask_cluster(here, [member]) as address:
            said = _refused(here, address)
        if not re.search(rf"^A worker .* has other software .*{name} \S+ in place of", said):
            return f"{name}: {said or 'not refused'}"
    return ""


def pids_of(workers: Workers) -> list[int]:
    """Process numbers of the workers of a cluster."""
    assert isinstance(workers.backend, Cluster)
    return list(workers.backend._link.ask(lambda client: client.run(os.getpid)).values())


def listening(pids: set[int]) -> list[tuple[str, int]]:
    """Interface (hexadecimal, as the kernel writes it) and port of each socket on which processes listen."""
    own = set()
    for pid in pids:
        for link in Path(f"/proc/{pid}/fd").iterdir():
            with suppress(OSError):
                own.add(os.readlink(link).removeprefix("socket:[").removesuffix("]"))
    found = []
    for table in ("tcp", "tcp6"):
        with suppress(FileNotFoundError):
            for line in Path(f"/proc/net/{table}").read_text(encoding="utf-8").splitlines()[1:]:
                _, local, _, state, *rest = line.split()
                if state == LISTENS and rest[5] in own:
                    where, port = local.split(":")
                    found.append((where, int(port, 16)))
    return found


@contextmanager
def silent_listener() -> Iterator[int]:
    """Port at which connections are accepted and nothing is said."""
    held: list[socket.socket] = []

    def accept() -> None:
        with suppress(OSError):
            while True:
                held.append(listener.accept()[0])

    with socket.create_server(("127.0.0.1", 0)) as listener:
        threading.Thread(target=accept, daemon=True).start()
        yield int(listener.getsockname()[1])
    for connection in held:
        connection.close()


def _enter(pipe: Connection) -> None:
    """Try all ports that come through a pipe, and send what let this process in."""
    import distributed

    other = distributed.Security.temporary()
    if os.getuid() == 0:
        os.setgroups([])
        os.setgid(NOBODY)
        os.setuid(NOBODY)
    ports, found = pipe.recv(), list[str]()
    tries = [partial(_as_client, f"tcp://127.0.0.1:{port}", None, found) for port in ports]
    tries += [partial(_as_client, f"tls://127.0.0.1:{port}", other, found) for port in ports]
    tries += [partial(_as_reader, f"http://127.0.0.1:{port}/{page}", found) for port in ports for page in PAGES]
    threads = [threading.Thread(target=one, daemon=True) for one in tries]
    for thread in threads:
        thread.start()
    end = time.monotonic() + ENTERS
    for thread in threads:
        thread.join(max(end - time.monotonic(), 0.0))
    pipe.send(found)


def _as_client(address: str, security: Any, found: list[str]) -> None:
    import distributed

    with suppress(Exception), distributed.Client(address, timeout=ENTERS, security=security, set_as_default=False):
        found.append(f"a client entered at {address}")


def _as_reader(page: str, found: list[str]) -> None:
    with suppress(OSError, HTTPException), urllib.request.urlopen(page, timeout=ENTERS):
        found.append(f"{page} is shown")


def _same_bytes(folder: Path, address: str) -> bool:
    """Return whether a run on a cluster has the bytes of one without."""
    case = Path(shutil.copytree(CASE, folder / "case")) / "study.toml"
    case.write_text(
        case.read_text(encoding="utf-8").replace("generations = 70", "generations = 4\npolish = 0"), encoding="utf-8"
    )
    study = load_study(case)
    calibrate_into(folder / "alone", study, threads=1)
    shortest, distributed_objective.SHORTEST = (
        distributed_objective.SHORTEST,
        1e-9,
    )  # a generation is cut up, though it lasts some ms
    try:
        with Workers.cluster(address) as workers:
            calibrate_into(folder / "run", study, threads=1, workers=workers)
    finally:
        distributed_objective.SHORTEST = shortest
    return _timeless(folder / "run") == _timeless(folder / "alone")


def _timeless(run: Path) -> tuple[str, bytes]:
    record = json.loads((run / "result.json").read_text(encoding="utf-8"))
    return json.dumps({key: value for key, value in record.items() if key != "clock"}), (
        run / "calibrated.toml"
    ).read_bytes()


def _count(address: str) -> int:
    with Workers.cluster(address) as workers:
        return workers.backend.count


def _refused(folder: Path, address: str) -> str:
    try:
        _same_bytes(folder, address)
    except CommonrailError as error:
        return str(error)
    return ""
