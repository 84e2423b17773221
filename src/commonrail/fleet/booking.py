"""Fingerprints under which an injector's result is booked: those of what its worker read."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from commonrail.fleet.supply import Supply
from commonrail.fleet.task import Attempt
from commonrail.reading.guarded_file import fingerprint

__all__ = ["Booking"]

Inputs = Mapping[str, str]


class Booking:
    """Comparison of what the workers of a fleet read with what they were given.

    Parameters
    ----------
    supply : Supply
    shared : mapping of Path to str
        SHA-256 of the files that are the same for all injectors, as they were when the fleet began.
    """

    def __init__(self, supply: Supply, shared: Mapping[Path, str]) -> None:
        self.supply = supply
        self._seen = dict(shared)
        self._written: dict[str, Mapping[Path, str]] = {}

    def hand_out(self, name: str, study: Path) -> Path:
        """Note the files that were written for an injector, of which `study` is one; returns that."""
        folder = study.absolute().parent
        self._written[name] = {path: fingerprint(path) for path in folder.iterdir() if path.is_file()}
        return study

    def book(self, name: str, attempt: Attempt, before: Inputs) -> tuple[Attempt, Inputs]:
        """Attempt and fingerprints of the data to be kept.

        Data that were changed while the fleet ran are booked as what they were when they were read. Where another file
        was changed, the attempt has failed, and has no fingerprints: the next run repeats it.

        Parameters
        ----------
        name : str
        attempt : Attempt
        before : mapping of str to str
            Fingerprints of the injector's data from when the fleet began.
        """
        written = self._written.pop(name, {})
        if not attempt.files:
            return attempt, before
        inputs = self.supply.fingerprints_read(name, attempt.files)
        data = set(inputs.values())
        for path, digest in attempt.files.items():
            if path in written or digest not in data:
                expected = written.get(path) or self._seen.setdefault(path, digest)
                if expected != digest:
                    reason = f"{path}: the file was changed while the fleet ran; run the fleet again."
                    return Attempt({}, reason, attempt.seconds), {}
        return attempt, inputs
