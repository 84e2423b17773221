"""Side of a worker of a cluster: it keeps the work that it was given, and does tasks of it."""

from __future__ import annotations

from typing import Any, NamedTuple

from commonrail.workers.process import Refused, reply
from commonrail.workers.task import Answer, Lost, Package

__all__ = ["Missing", "perform_held"]


class Missing(NamedTuple):
    """Answer of a worker that does not have the work."""


_HELD: dict[str, Package] = {}  # on a worker; two, so that two studies on one cluster can take turns


def perform_held(key: str, package: Package | None, argument: Any) -> Answer | Lost | Refused | Missing:
    """Answer of a task, on its worker, by the work that is given, or that was given before.

    Parameters
    ----------
    key : str
        Of the package.
    package : Package or None
    argument : picklable

    Notes
    -----
    Data of Dask's own would be lost with the workers that have them, and out of reach behind one that hangs. An error
    is returned: of those that Dask passes on, some do not arrive.
    """
    if package is not None:
        while key not in _HELD and len(_HELD) > 1:
            _HELD.pop(next(iter(_HELD)), None)
        _HELD[key] = package
    held = _HELD.get(key)
    return Missing() if held is None else reply(held, argument)
