"""Dask clusters on this machine as others would run them: a scheduler, workers that may misbehave, and certificates."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

SLOWEST = 600.0  # [s] A scheduler or worker that is not there by then is called missing; they take seconds.
TLS = "DASK_DISTRIBUTED__COMM__TLS__"


class Member(NamedTuple):
    """A worker: Python code that it runs first, and additions to its environment."""

    preload: str = ""
    environment: Mapping[str, str] = {}


@contextmanager
def dask_cluster(
    folder: Path, members: Sequence[Member] = (), environment: Mapping[str, str] | None = None
) -> Iterator[str]:
    """Address of a scheduler, and of workers without a nanny, each a process of its own.

    Parameters
    ----------
    folder : Path
        For what they need.
    members : sequence of Member
    environment : mapping of str to str, optional
        Additions for all; with those of `certificates` they speak TLS alone.
    """
    environment = environment or {}
    contact = folder / "scheduler.json"
    shared = ["--protocol", "tls" if f"{TLS}CA_FILE" in environment else "tcp", "--no-dashboard"]
    shared += ["--scheduler-file", str(contact)]
    started = [_start("scheduler", ["--host", "127.0.0.1", "--port", "0", *shared], environment)]
    try:
        _wait(started, lambda: contact.exists() and contact.stat().st_size > 0)
        for i, member in enumerate(members):
            line = ["--no-nanny", "--nthreads", "1", "--host", "127.0.0.1", "--local-directory", str(folder), *shared]
            if member.preload:
                script = folder / f"preload_{i}.py"
                script.write_text(member.preload, encoding="utf-8")
                line += ["--preload", str(script)]
            started.append(_start("worker", line, {**environment, **member.environment}))
        address = str(json.loads(contact.read_text(encoding="utf-8"))["address"])
        if members:
            with dask_client(address, environment) as client:
                client.wait_for_workers(len(members), timeout=SLOWEST)
        yield address
    finally:
        for process in started:
            process.kill()
            process.wait()


def dask_client(address: str, environment: Mapping[str, str] | None = None) -> Any:
    """Client of a scheduler, with the certificates that an environment names."""
    import distributed

    names = {"ca_file": "CA_FILE", "client_cert": "CLIENT__CERT", "client_key": "CLIENT__KEY"}
    files = {f"tls_{ours}": (environment or {}).get(TLS + theirs) for ours, theirs in names.items()}
    security = distributed.Security(require_encryption=True, **files) if files["tls_ca_file"] else None
    return distributed.Client(address, timeout=SLOWEST, set_as_default=False, security=security)


def certificates(folder: Path) -> dict[str, str]:
    """Environment that names a new certificate and its key for scheduler, workers and clients; they accept no other."""
    import distributed

    made = distributed.Security.temporary()
    files = {"ca.pem": made.tls_ca_file, "cert.pem": made.tls_client_cert, "key.pem": made.tls_client_key}
    folder.mkdir(mode=0o700)
    for name, content in files.items():
        (folder / name).write_text(content, encoding="utf-8")
    found = {f"{TLS}CA_FILE": str(folder / "ca.pem"), "DASK_DISTRIBUTED__COMM__REQUIRE_ENCRYPTION": "True"}
    for role in ("SCHEDULER", "WORKER", "CLIENT"):
        found |= {f"{TLS}{role}__CERT": str(folder / "cert.pem"), f"{TLS}{role}__KEY": str(folder / "key.pem")}
    return found


def _start(kind: str, line: Sequence[str], environment: Mapping[str, str]) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", f"distributed.cli.dask_{kind}", *line],
        env={**os.environ, **environment},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def _wait(processes: Sequence[subprocess.Popen[bytes]], happened: Any) -> None:
    start = time.monotonic()
    while not happened():
        if time.monotonic() - start > SLOWEST or any(process.poll() is not None for process in processes):
            raise RuntimeError("the scheduler did not start")
        time.sleep(0.01)
