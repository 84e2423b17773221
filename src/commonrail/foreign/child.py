"""Simulation of a foreign FMU inside a process of its own: what it does there cannot harm the search."""

from __future__ import annotations

import functools
import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from commonrail.arrays import Floats
from commonrail.foreign.data import Run, Setting
from commonrail.foreign.statuses import FmuStatus

__all__ = ["FATAL_EXIT", "Answered", "Asked", "FmuWork"]


FATAL_EXIT = 71  # of a process whose FMU may not be called any more
LONGEST = 300  # characters of a message
DISCARD, ERROR = 2, 3  # statuses of the standard
_STATUSES = {DISCARD: FmuStatus.FMU_DISCARDED, ERROR: FmuStatus.FMU_ERROR}
_Found = tuple[Floats | None, FmuStatus, str]
_NEAR = 1e-6  # share of a communication step that rounding may move the end by


class Asked(NamedTuple):
    """Run by its number, values of the calibrated variables, and the number of steps that replace one."""

    number: int
    values: tuple[float, ...]
    finer: int = 1


class Answered(NamedTuple):
    """Values (n,) of a run, NaN where it failed, its status, and what the FMU has said."""

    values: Floats
    status: int
    told: str


@dataclass(frozen=True)
class FmuWork:
    """Work of the processes: one simulation of one candidate.

    Attributes
    ----------
    folder : str
        Files of the FMU.
    digest : str
        SHA-256 of the FMU.
    names : tuple of str
        Variables that are calibrated.
    runs : tuple of Run
    step : float
        Communication step [s].
    """

    folder: str
    digest: str
    names: tuple[str, ...]
    runs: tuple[Run, ...]
    step: float
    same_bits: bool = True  # its bits are not those of our compiler

    def probe(self) -> bytes:
        """Digest of the FMU: it is loaded where it can do no harm, never in the calling process."""
        return self.digest.encode()

    def __call__(self, argument: Asked) -> Answered:
        """Result of a run with values of the calibrated variables."""
        number, values, finer = argument
        run = self.runs[number]
        _keep_the_output_clean()
        start = {**run.start, **dict(zip(self.names, values, strict=True))}
        found, status, told = _simulated(self.folder, run, start, self.step / finer)
        return Answered(np.full(run.size, np.nan) if found is None else found, int(status), told)


@functools.cache
def _keep_the_output_clean() -> None:
    """Send what the FMU prints to standard error: standard output may hold a record."""
    os.dup2(2, 1)


@functools.cache
def _description(folder: str) -> Any:
    from fmpy import read_model_description

    return read_model_description(folder, validate=False)


def _simulated(folder: str, run: Run, start: Mapping[str, Setting], step: float) -> _Found:
    from fmpy.fmi1 import FMICallException
    from fmpy.simulation import instantiate_fmu

    said: list[str] = []
    try:
        instance = instantiate_fmu(
            folder,
            _description(folder),
            "CoSimulation",
            logger=lambda *row: said.append(_text(row[-1])),
            require_functions=False,
        )
    except Exception as error:  # whatever loading a library may raise
        return None, FmuStatus.FMU_NOT_STARTED, _told(said, error)
    _end_at_discard(instance, FMICallException)
    try:
        found = _courses(instance, folder, run, start, step)
    except _Discarded as error:
        return _freed(instance, (None, FmuStatus.FMU_DISCARDED, _told(said, error)))
    except FMICallException as error:
        if error.status not in _STATUSES:
            os._exit(FATAL_EXIT)  # the standard forbids any further call of the FMU
        return _freed(instance, (None, _STATUSES[error.status], _told(said, error)))
    except Exception as error:  # a termination that the FMU asks for, a value that it cannot take
        return _freed(instance, (None, FmuStatus.FMU_ERROR, _told(said, error)))
    return _freed(instance, _sampled(found, run, step))


def _courses(instance: Any, folder: str, run: Run, start: Mapping[str, Setting], step: float) -> Any:
    from fmpy.simulation import simulate_fmu

    return simulate_fmu(
        folder,
        validate=False,
        start_time=0.0,
        stop_time=step * np.ceil(run.stop / step - _NEAR),
        output_interval=step,
        start_values=start,
        input=_signals(run),
        output=list(run.outputs),
        model_description=_description(folder),
        fmu_instance=instance,
    )


def _signals(run: Run) -> Any:
    if run.inputs is None:
        return None
    table = np.zeros(len(run.inputs.times), [("time", float), *((name, float) for name in run.inputs.values)])
    table["time"] = run.inputs.times
    for name, own in run.inputs.values.items():
        table[name] = own
    return table


def _sampled(found: Any, run: Run, step: float) -> _Found:
    """Values at the times of a run, linear between communication points."""
    times = found["time"]
    if times[-1] < run.times[-1] - _NEAR * step:
        return None, FmuStatus.FMU_ENDED_EARLY, f"the simulation ended at {times[-1]:.6g} s"
    courses = [np.asarray(found[name], float) for name in run.outputs]
    for name, own in zip(run.outputs, courses, strict=True):
        if not np.isfinite(own).all():
            return None, FmuStatus.FMU_NOT_FINITE, f"{name} is not finite"
    return np.concatenate([np.interp(run.times, times, own) for own in courses]), FmuStatus.FMU_OK, ""


def _freed(instance: Any, result: _Found) -> _Found:
    instance.freeInstance()
    return result


class _Discarded(Exception):
    """A step that the FMU has discarded."""


def _end_at_discard(instance: Any, failure: Any) -> None:
    """End a simulation at a step that is discarded: FMPy would repeat it for ever."""
    step = instance.doStep

    def once(*given: Any, **named: Any) -> Any:
        try:
            return step(*given, **named)
        except failure as error:
            if error.status == DISCARD:
                raise _Discarded(str(error)) from error
            raise

    instance.doStep = once


def _text(message: Any) -> str:
    return message.decode("utf-8", "replace") if isinstance(message, bytes) else str(message)


def _told(said: list[str], error: BaseException) -> str:
    return " ".join(" ".join([str(error), *said[-1:]]).split())[:LONGEST]
