"""Python processes that this one starts: modules in the current folder, which may be anybody's, are never run."""

from __future__ import annotations

import os
import sys

SAFE_PATH = "PYTHONSAFEPATH"  # variable that keeps the current folder off the path of every Python below


def python(*arguments: str) -> list[str]:
    """Command line of this Python with a path of modules without the current folder."""
    return [sys.executable, "-P", *arguments]


def same_modules() -> dict[str, str]:
    """Environment of a process that imports the same modules as this one, also uninstalled ones."""
    return os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path), SAFE_PATH: "1"}
