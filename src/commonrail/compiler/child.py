"""Child process that lowers laws to LLVM's text.

Numba types and lowers laws in a child process, for a generic processor. The child runs Numba without optimisation and
vectorisation, so that the caller's Numba is unaffected, and keeps laws typed for earlier kernels. It ends with its
parent, or after some idle time.
"""

from __future__ import annotations

import atexit
import contextlib
import json
import os
import subprocess
import tempfile
import threading
from typing import Any

from commonrail.base.child import python, same_modules
from commonrail.base.errors import ConfigurationError
from commonrail.compiler.cache import Source, get_or_make
from commonrail.compiler.lower import NUMBA
from commonrail.compiler.target import may_compile


def texts(source: Source) -> dict[str, str]:
    """LLVM text of each function by its name, which is also its name in the text; from the cache if possible.

    `ConfigurationError` if the compiler fails, or ``NUMBA_DISABLE_JIT`` forbids compiling.
    """
    texts_by_name: dict[str, str] = json.loads(get_or_make(f"{source.digest}.text", lambda: _lower(source)))
    return texts_by_name


def _lower(source: Source) -> bytes:
    if not may_compile():
        raise ConfigurationError(
            "The fast engine needs its compiler, which NUMBA_DISABLE_JIT switches off; unset it, or use the engine "
            '"reference".'
        )
    with _TURN:
        # a child may reach the end of its idle time just as it is asked
        answer = _child(source.kind).ask(source) or _child(source.kind).ask(source) or {"fault": "it has ended"}
    if "fault" in answer:
        raise ConfigurationError(f"Compiling the simulation failed: {answer['fault']}.")
    return json.dumps(answer["texts"]).encode()


_TURN = threading.Lock()
_CHILDREN: dict[tuple[int, str], _Child] = {}


def _child(kind: str) -> _Child:
    """Child of this process for a kind of kernel; a forked process has its own."""
    key = os.getpid(), kind
    child = _CHILDREN.get(key)
    if child is None or child.process.poll() is not None:
        child = _CHILDREN[key] = _Child(kind)
        atexit.register(child.end)
    return child


class _Child:
    """Process that lowers one kind of kernel."""

    def __init__(self, kind: str) -> None:
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 - open as long as the process
        self.process = subprocess.Popen(
            python("-m", "commonrail.compiler.lower", kind),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            start_new_session=True,  # Ctrl-C reaches only this process, which may have to finish its work
            creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),  # the same on Windows, 0 elsewhere
            env=same_modules() | NUMBA,
        )

    def ask(self, source: Source) -> dict[str, Any] | None:
        """Texts of a source, or a fault; None if the process has ended after its idle time."""
        line = b""
        try:
            with contextlib.suppress(BrokenPipeError):
                self.process.stdin.write(json.dumps(source).encode() + b"\n")  # type: ignore[union-attr]
                self.process.stdin.flush()  # type: ignore[union-attr]
                line = self.process.stdout.readline()  # type: ignore[union-attr]
        finally:
            if not line:
                self.end()
        if line:
            answer: dict[str, Any] = json.loads(line)
            return answer
        if self.process.returncode == 0:
            return None
        self._errors.seek(0)
        said = self._errors.read().decode(errors="replace").strip().splitlines()[-1:] or ["it ended without a message"]
        return {"fault": said[0].rstrip(".")}

    def end(self) -> None:
        """End the process."""
        self.process.kill()
        self.process.wait()
