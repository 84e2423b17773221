"""Greeting of the workers of a cluster: those with other software than this process are known before they get work."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from commonrail.compile_target import PACKAGES
from commonrail.workers.task import software, unlike

if TYPE_CHECKING:
    from distributed import Client

__all__ = ["differing"]

_NONE = "no commonrail; install there what is installed here."
_OTHER = "another commonrail of the same version number ({error}); install there what is installed here."


# Of Python alone, so that a worker with any commonrail, or none, understands it, and without errors: those of a worker
# do not always arrive in one piece.
_VERSIONS = f"""
(lambda metadata: {{
    package: ([found.version for found in metadata.distributions(name=package)] or [""])[0] for package in {PACKAGES}
}})(__import__("importlib.metadata", fromlist=["metadata"]))
""".strip()


def differing(names: Sequence[str], client: Client) -> dict[str, str]:
    """Difference between the software of this process and that of workers.

    The compiler's target is compared when a worker takes up work: some work has the same bits on every one.

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
    own = dict(software(same_bits=True))
    found = client.run(eval, _VERSIONS, workers=list(names), on_error="ignore")
    return {name: _fault(said, own) or _fault_of_code(name, client) for name, said in found.items()}


def _fault(said: Mapping[str, str], own: Mapping[str, str]) -> str:
    return unlike({package: own[package] for package in PACKAGES}, said) if said["commonrail"] else _NONE


def _fault_of_code(name: str, client: Client) -> str:
    try:
        client.run(software, workers=[name], on_error="raise")
        return ""
    except OSError:  # it has left
        return ""
    except Exception as error:  # what this process asks for is not there
        return _OTHER.format(error=type(error).__name__)
