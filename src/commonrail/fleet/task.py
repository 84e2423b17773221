"""Calibration of one injector on a worker, and the record that is kept of it."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from commonrail.analysis.certainty.linear import Near, certify_near
from commonrail.calibration.result import warning_records
from commonrail.calibration.run import Calibration, calibrate, scores_of
from commonrail.calibration.study import Study
from commonrail.display.text import number
from commonrail.errors import CommonrailError
from commonrail.files.study_file import load_study
from commonrail.injector.definition import Injector
from commonrail.kinds import DataSet, Score

__all__ = ["Attempt", "Calibrations", "calibrate_study", "failed"]


class Attempt(NamedTuple):
    """Outcome of an injector on its worker.

    Attributes
    ----------
    record : mapping
    reason : str
        Sentence of an error if it cannot be calibrated.
    seconds : float
        Processor time [s].
    files : mapping of Path to str
        SHA-256 of each file as it was read.
    """

    record: Mapping[str, Any]
    reason: str
    seconds: float
    files: Mapping[Path, str] = {}


def failed(error: CommonrailError, seconds: float = 0.0) -> Attempt:
    """Attempt that ended with an error."""
    return Attempt({}, " ".join(str(error).split()), seconds)


class Calibrations:
    """Calibrations of the injectors of a fleet: the work of its workers.

    Parameters
    ----------
    first : Study or None
        One of them, to try a worker with.
    """

    def __init__(self, first: Study | None) -> None:
        self.first = first

    def __call__(self, given: Study | Path) -> Attempt:
        """Attempt at a study, which may be its file."""
        start = time.thread_time()  # on a busy machine too it says what the work costs
        try:
            study = load_study(given) if isinstance(given, Path) else given
            record = calibrate_study(study)
        except CommonrailError as error:
            return failed(error, time.thread_time() - start)
        return Attempt(record, "", time.thread_time() - start, dict(study.files))

    @property
    def same_bits(self) -> bool:
        """As the studies have it."""
        return self.first is not None and self.first.same_bits

    def probe(self) -> bytes:
        """Figures of the first study's start values; what every study needs is loaded then."""
        if self.first is None:
            return b""
        scores = scores_of(self.first, self.first.injector, 1)["best"]
        return json.dumps([_data(d, s, s) for d, s in zip(self.first.data, scores, strict=True)]).encode()


def calibrate_study(study: Study) -> dict[str, Any]:
    """Calibrate the study of an injector on one thread.

    Returns
    -------
    dict
        "seed", "synthetic", "J" of start and best, "slots", "simulated", "failed" candidates, "data", "parameters" and
        "warnings".

    Raises
    ------
    CommonrailError
        If the study cannot be run, or no candidate can be simulated.
    """
    calibration = calibrate(study, threads=1)
    if calibration.status != "finished":
        raise KeyboardInterrupt
    counts = calibration.counts
    return {
        "seed": study.seed,
        "synthetic": study.synthetic,
        "J": {"start": number(calibration.start_cost), "best": number(calibration.cost)},
        "slots": counts.slots,
        "simulated": counts.simulated,
        "failed": counts.failed,
        "data": [
            _data(d, calibration.scores["start"][i], calibration.scores["best"][i]) for i, d in enumerate(study.data)
        ],
        "fixed": [_fixed(study.injector, name) for name in study.fixed],
        "parameters": _parameters(calibration, certify_near(study, calibration.best, 1)),
        "warnings": warning_records(calibration.warnings),
    }


def _fixed(injector: Injector, name: str) -> dict[str, Any]:
    mark, source = injector.sources[name]
    return {"name": name, "value": injector.values[name], "mark": mark, "source": source}


def _data(data: DataSet, start: Score, best: Score) -> dict[str, Any]:
    measure, unit = data.error_head
    found = {"name": data.name, "role": data.role.value, "measure": measure, "unit": unit}
    return found | {"start": number(start.error), "best": number(best.error)}


def _parameters(calibration: Calibration, certain: Mapping[str, Near]) -> dict[str, dict[str, Any]]:
    space = calibration.study.space
    found = {}
    for p in space.parameters:
        best = calibration.best[p.name]
        found[p.name] = {
            "best": best,
            "standard_error": certain[p.name].standard_error,
            "verdict": certain[p.name].verdict.value,
            "position": p.position(best),
            "at_bound": p.is_at_bound(best),
            "lower": p.lower,
            "upper": p.upper,
            "prior": None if p.prior is None else {"value": p.prior.value, "sigma": p.prior.sigma},
        }
    return found
