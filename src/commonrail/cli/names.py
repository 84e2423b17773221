"""Names of the verbs, and the function of each, whose module is imported when it is asked for."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

__all__ = ["VERBS", "function_of"]

# In the order of the help; a verb is the function of its name in the module of its name.
VERBS = (
    "simulate",
    "calibrate",
    "resume",
    "runs",
    "validate",
    "certainty",
    "next",
    "predict",
    "compare",
    "fleet",
    "family",
    "adapt",
    "sensitivity",
    "tolerance",
    "map",
    "sweep",
    "inspect",
    "features",
    "report",
    "export",
    "page",
    "verify",
    "catalogue",
    "new",
    "virtual-bench",
    "reproduce",
    "doctor",
)


def function_of(name: str) -> Callable[..., Any]:
    """Function of a verb; it has a `_` at its end where Python has a name of its own."""
    own = name.replace("-", "_")
    module = import_module(f"commonrail.cli.{own}")
    return getattr(module, own, None) or getattr(module, f"{own}_")  # type: ignore[no-any-return]
