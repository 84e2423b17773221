"""Record of a fit, result.json, as its readers see it: attributes, with defaults where a record has no such key."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, NamedTuple, TypeVar

from commonrail.base.errors import InputError
from commonrail.base.record import BrokenRecordError, Key, from_record
from commonrail.calibration.optimisers.base import AGREEING
from commonrail.calibration.parameter import Prior
from commonrail.calibration.plausibility import Finding
from commonrail.data.records import Record

_Kind = TypeVar("_Kind")


def read_as(kind: type[_Kind], record: Record, file: Path | None = None) -> _Kind:
    """Read a JSON-able record as one of the classes below; `BrokenRecordError` if it is none.

    `file`: where the record is from; without it, the sentence begins with the key.
    """
    try:
        return from_record(kind, record)
    except BrokenRecordError as error:
        if file is None:
            raise
        raise InputError(f"{file}: {error}; make it again.") from error


# The search, as all kinds of fit have it.


class SearchVerdict(NamedTuple):
    """Convergence of a search, by its population (`spread`) or by its starts (`agreeing`)."""

    converged: bool
    sentence: str
    spread: float | None = None
    starts: int | None = None
    agreeing: int | None = None
    cut_short: bool = True


class StartAndBest(NamedTuple):
    """Objective of the start values and of the best; None where these could not be simulated."""

    start: float | None
    best: float | None


class Evaluations(NamedTuple):
    """Numbers of candidates, and of injections or simulations of an FMU."""

    slots: int
    simulated: int
    failed: int
    injections: int = 0
    simulations: int = 0


class GenerationRecord(NamedTuple):
    """Objective after a generation."""

    generation: int
    best: float | None
    mean: float | None


class Clock(NamedTuple):
    """All that depends on the clock."""

    seconds: float
    simulations_per_second: float
    ended: str = ""


@dataclass(frozen=True, kw_only=True)
class FitRecord:
    """The part of a record that all kinds of fit share, see `commonrail.calibration.result.fit_record`."""

    title: str
    seed: int
    status: str
    objective: StartAndBest
    generations: tuple[GenerationRecord, ...]
    evaluations: Evaluations
    optimiser: Mapping[str, Any]
    clock: Clock
    software: Mapping[str, str]
    synthetic: str = ""
    reason: str = ""
    convergence: SearchVerdict | None = None
    loss_scale: float | None = None

    @property
    def is_interrupted(self) -> bool:
        """True if the search was stopped before its end."""
        return self.status == "interrupted"

    @property
    def has_not_converged(self) -> bool:
        """True if the search says of itself that it has not converged."""
        return self.convergence is not None and not self.convergence.converged


# Parameters, and how well the data determine them.


class ParameterRecord(NamedTuple):
    """A calibrated parameter [SI].

    `effect`, `pinned`: changes of the residuals for a move of 1 % of the range, alone and with the other parameters
    readjusted. `pull`: distance of the best value from the prior in standard deviations of the prior.
    """

    name: str
    unit: str
    meaning: str = ""
    reference: float = math.nan
    lower: float = -math.inf
    upper: float = math.inf
    best: float = math.nan
    mark: str = ""
    source: str = ""
    position: float = math.nan
    at_bound: bool = False
    prior: Prior | None = None
    pull: float | None = None
    effect: float | None = None
    pinned: float | None = None
    standard_error: float | None = None
    verdict: str | None = None


class CertainParameter(NamedTuple):
    """Most likely value and interval [SI] of a parameter; `percent` is half the interval over the value."""

    name: str
    value: float
    lower: float | None
    upper: float | None
    percent: float | None = None
    sentence: str = ""
    cure: str = ""


class BenchQuantity(NamedTuple):
    """A quantity of the bench that was fitted with the parameters: as stated, and by the data [SI]."""

    name: str
    unit: str
    source: str
    stated: float
    deviation: float
    value: float
    standard_error: float | None


class CombinedValue(NamedTuple):
    """Value and interval [SI] of a sum of parameters."""

    sum: str
    value: float
    lower: float
    upper: float


class NoiseRecord(NamedTuple):
    """Noise of a data set: law, standard deviation `sigma` [unit], and its growth with the rate, `relative`."""

    name: str
    law: str
    order: int
    sigma: float
    relative: float
    unit: str
    stated: bool
    values: int
    share: float
    parameters: float


class LackOfFitRecord(NamedTuple):
    """A test for lack of fit, and what it suspects."""

    name: str
    detected: Annotated[bool, Key("found")]
    sentence: str
    suspect: str | None = None
    probability: float | None = None
    score: float | None = None
    size: float | None = None
    relief: float | None = None  # share of the error that freeing the suspect promises to take away


class CertaintyRecord(NamedTuple):
    """Certainty of a fit: intervals that hold the truth with the probability `level`, and what they rest on.

    `draws_refused`: reason why the intervals are not taken from posterior draws alone.
    """

    level: float
    parameters: tuple[CertainParameter, ...]
    starts: int = 1
    agreeing: int = 0
    settled: bool = False
    withdrawn: str = ""
    discrepancy: float = 0.0
    widening: float | None = None  # share of the error that wider bounds promise to take away
    draws_refused: Annotated[str, Key("draws.refused")] = ""
    bench: tuple[BenchQuantity, ...] = ()
    combinations: tuple[CombinedValue, ...] = ()
    noise: tuple[NoiseRecord, ...] = ()
    tests: tuple[LackOfFitRecord, ...] = ()

    @property
    def confirms(self) -> bool:
        """True if the search has converged and enough starts agree."""
        return self.settled and self.agreeing >= AGREEING


class DirectionRecord(NamedTuple):
    """A combination of parameters that the data determine: weight of each, in widths of the bounds."""

    singular_value: float
    weights: Mapping[str, float]


class InfluenceRecord(NamedTuple):
    """Influence of the data on the parameters."""

    residuals: int
    effective_parameters: float
    scatter: float
    combinations: tuple[DirectionRecord, ...] = ()


# Further searches.


class SeedRecord(NamedTuple):
    """End of the search with another seed."""

    seed: int
    failed: bool = False
    objective: float | None = None
    errors: Mapping[str, float | None] = MappingProxyType({})
    error_heads: Mapping[str, str] = MappingProxyType({})
    positions: Mapping[str, float] = MappingProxyType({})


class BaselineRecord(NamedTuple):
    """A trivial model on data that the fit has not seen."""

    text: str
    beaten: bool | None = None
    figures: Record = MappingProxyType({})
    extrapolated: int | None = None


class LeftOutRecord(NamedTuple):
    """Rows that were held out in turn, and how well they were predicted; `mean` is that of the members."""

    name: str
    by: str
    searches: int
    values: int
    figures: Record
    failed: tuple[str, ...] = ()
    mean: Record | None = None
    baselines: tuple[BaselineRecord, ...] = ()


class RefitsRecord(NamedTuple):
    """Searches with other seeds and without some rows; `interrupted` if the user stopped before the last."""

    seeds: tuple[SeedRecord, ...] = ()
    left_out: tuple[LeftOutRecord, ...] = ()
    interrupted: bool = False


NO_REFITS = RefitsRecord()

# The study.


class InjectorRecord(NamedTuple):
    """Injector of a study."""

    name: str
    variant: str
    title: str = ""


class MeterQuantity(NamedTuple):
    """A quantity of a meter [SI]."""

    name: str
    value: float
    unit: str
    mark: str


class MeterRecord(NamedTuple):
    """A meter with its calibrated quantities."""

    name: str
    law: str
    order: int
    quantities: tuple[MeterQuantity, ...]


@dataclass(frozen=True, kw_only=True)
class CalibrationRecord(FitRecord):
    """Record of a calibration; those of its data sets are read by their kinds of data."""

    injector: InjectorRecord
    parameters: tuple[ParameterRecord, ...]
    data: tuple[Record, ...]
    time_step: float = 1e-6
    precision: str = "f64"
    same_bits: bool = False
    labels: Mapping[str, str]
    warnings: tuple[Finding, ...] = ()
    meters: tuple[MeterRecord, ...] = ()
    identifiability: InfluenceRecord | None = None
    certainty: CertaintyRecord | None = None
    refits: RefitsRecord = NO_REFITS
