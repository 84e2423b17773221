"""A module in a fresh process of the same Python."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from typing import Any

__all__ = ["Runner", "ask_child", "run_child"]

Runner = Callable[[str, list[str], float], subprocess.CompletedProcess[str]]


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


def ask_child(module: str, arguments: list[str], seconds: float, run: Runner = run_child) -> dict[str, Any]:
    """Return the JSON object that a module prints, or {"failed": sentence}.

    Parameters
    ----------
    module, arguments, seconds
        As for `run_child`.
    run : function
        Runs it.
    """
    try:
        done = run(module, arguments, seconds)
    except subprocess.TimeoutExpired:
        return {"failed": f"not done within {seconds:g} s"}
    if done.returncode != 0:
        return {"failed": _reason(done)}
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def _reason(done: subprocess.CompletedProcess[str]) -> str:
    if done.returncode < 0:
        return f"the process was ended by signal {-done.returncode}, as a system does that is short of memory"
    last = done.stderr.strip().splitlines()[-1:] or ["no message"]
    return f"the process ended with status {done.returncode}: {last[0]}"
