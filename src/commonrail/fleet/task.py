"""What a worker does with one injector, and what is kept of it."""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

from commonrail.analysis.identifiability import identify
from commonrail.calibration.result import warning_records
from commonrail.calibration.run import Calibration, calibrate, scores_of
from commonrail.calibration.worker import heed_caller_alone
from commonrail.display.text import number
from commonrail.errors import CommonrailError
from commonrail.files.study_file import load_study
from commonrail.kinds import DataSet, Score

__all__ = ["Answer", "Done", "Lost", "Refused", "Up", "calibrate_file", "serve"]


class Done(NamedTuple):
    """An injector is calibrated: its record, and the processor time that it took [s]."""

    record: dict[str, Any]
    seconds: float


class Refused(NamedTuple):
    """An injector cannot be calibrated, however often it is tried: the error's sentence, and its processor time [s]."""

    reason: str
    seconds: float


class Lost(NamedTuple):
    """An attempt came to nothing: the end of a sentence that begins with "the worker"."""

    reason: str


class Up(NamedTuple):
    """First word of a worker."""


Answer = Done | Refused | Lost


def calibrate_file(path: Path) -> dict[str, Any]:
    """Calibrate one study on one thread.

    Returns
    -------
    dict
        "seed", "synthetic", "J" of start and best, "slots", "simulated", "failed" candidates, "data", "parameters" and
        "warnings".

    Raises
    ------
    CommonrailError
        If the study or its data cannot be used, or no candidate can be simulated.
    """
    study = load_study(path)
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
        "parameters": _parameters(calibration, identify(calibration, 1)),
        "warnings": warning_records(calibration.warnings),
    }


def _data(data: DataSet, start: Score, best: Score) -> dict[str, Any]:
    measure, unit = data.error_head
    found = {"name": data.name, "role": data.role.value, "measure": measure, "unit": unit}
    return found | {"start": number(start.error), "best": number(best.error)}


def _parameters(calibration: Calibration, identified: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    space = calibration.study.space
    found = {}
    for p in space.parameters:
        best = calibration.best[p.name]
        found[p.name] = {
            "best": best,
            "standard_error": identified[p.name]["standard_error"],
            "verdict": identified[p.name]["verdict"],
            "position": p.position(best),
            "at_bound": p.is_at_bound(best),
        }
    return found


def serve(pipe: Connection) -> None:
    """Body of a worker process: calibrate the studies it is told, until the calling process is gone.

    A stop signal goes to the whole group of processes; the calling process alone decides what becomes of it.
    """
    heed_caller_alone()
    with suppress(EOFError, BrokenPipeError):
        pipe.send(Up())
        path = Path(pipe.recv())
        _warm_up(path)
        while True:
            pipe.send(_answer(path))
            path = Path(pipe.recv())


def _warm_up(path: Path) -> None:
    """Load what every study needs, so that it does not count as the first one's cost."""
    with suppress(Exception):  # what is wrong with the study is told when it is calibrated
        study = load_study(path)
        scores_of(study, study.injector, 1)


def _answer(path: Path) -> Answer:
    start = time.process_time()  # on a busy machine too it says what the work costs
    try:
        record = calibrate_file(path)
    except CommonrailError as error:
        return Refused(" ".join(str(error).split()), time.process_time() - start)
    except (Exception, KeyboardInterrupt) as error:  # tried again, then told in a sentence
        return Lost(f"met {type(error).__name__}: {' '.join(str(error).split())[:200]}".rstrip(": "))
    return Done(record, time.process_time() - start)
