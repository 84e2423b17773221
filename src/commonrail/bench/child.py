"""A module in a fresh process of the same Python."""

from __future__ import annotations

import os
import subprocess
import sys

__all__ = ["reason", "run_child"]


def run_child(module: str, arguments: list[str], seconds: float) -> subprocess.CompletedProcess[str]:
    """Run ``python -m module arguments``.

    Parameters
    ----------
    module : str
        Found where this process finds its own, also what is not installed.
    arguments : list of str
    seconds : float
        After these `subprocess.TimeoutExpired` is raised.
    """
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    command = [sys.executable, "-m", module, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=seconds, env=environment, check=False)


def reason(done: subprocess.CompletedProcess[str]) -> str:
    """Why it did not end well."""
    if done.returncode < 0:
        return f"the process was ended by signal {-done.returncode}, as a system does that is short of memory"
    last = done.stderr.strip().splitlines()[-1:] or ["no message"]
    return f"the process ended with status {done.returncode}: {last[0]}"
