"""Greeting of the workers of a cluster: those with other software than this process are known before they get work."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

from commonrail.compile_target import PACKAGES
from commonrail.workers.task import software, unlike

if TYPE_CHECKING:
    from distributed import Client

__all__ = ["differing"]

_NONE = "no commonrail; install there what is installed here."
_OTHER = "another commonrail of the same version number ({error}); install there what is installed here."


def differing(names: Sequence[str], client: Client) -> dict[str, str]:
    """Difference between the software of this process and that of workers.

    Versions are asked for with Python's own functions, which a worker with any commonrail, or none, understands; the
    compiler's target only where they agree.

    Parameters
    ----------
    names : sequence of str
        Addresses of the workers.
    client : Client

    Returns
    -------
    dict of str to str
        For each worker that answers, the end of the sentence "The worker … has …", "" where nothing differs.
    """
    own = dict(software())
    found: dict[str, dict[str, Any]] = {}
    for package in PACKAGES:
        for name, said in client.run(version, package, workers=list(names), on_error="return").items():
            found.setdefault(name, {})[package] = said
    answered = {name: said for name, said in found.items() if all(map(_is_known, said.values()))}
    return {name: _fault(said, own) or _fault_of_target(name, own, client) for name, said in answered.items()}


def _is_known(said: Any) -> bool:
    """Return whether a worker answered: with a version, or that the package is not there."""
    return isinstance(said, str | PackageNotFoundError)


def _fault(said: Mapping[str, Any], own: Mapping[str, str]) -> str:
    installed = {package: version for package, version in said.items() if isinstance(version, str)}
    if "commonrail" not in installed:
        return _NONE
    return unlike({package: own[package] for package in PACKAGES}, installed)


def _fault_of_target(name: str, own: Mapping[str, str], client: Client) -> str:
    said = client.run(software, workers=[name], on_error="return").get(name)
    if isinstance(said, OSError):
        return ""  # it has left
    try:
        return unlike(own, dict(said))
    except (TypeError, ValueError):
        return _OTHER.format(error=said)
