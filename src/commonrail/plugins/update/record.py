"""Record of an update, update.json in the folder of the new run."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import Any, NamedTuple

from commonrail.data.base import Role

RECORD = "update.json"


class Agreement(StrEnum):
    """Agreement of new data with the predictions of a run."""

    AGREES = "agrees"
    """The 90 % bands hold enough values."""

    OUTSIDE = "outside the bands"
    """The 90 % bands hold too few values."""

    CONTRADICTS = "contradicts"
    """Too many values lie outside the 99.9 % bands: injector or bench have probably changed."""

    UNJUDGED = "not judged"
    """Bands are missing: data of this kind were not fitted or are gone, or the run has no draws."""


class ErrorSize(NamedTuple):
    """Error of a data set as a share of its values, or in tolerances; None if a simulation failed."""

    size: float | None
    in_tolerances: bool


class Baseline(NamedTuple):
    """Trivial model, and whether the run beats it; None if an error is missing."""

    text: str
    beaten: bool | None


class NewData(NamedTuple):
    """New data set, judged by the run; numbers of its values, inside the 90 % and outside the 99.9 % bands if any."""

    name: str
    role: Role
    error: ErrorSize
    baseline: Baseline | None
    agreement: Agreement
    values: int | None = None
    covered: int | None = None
    far: int | None = None


class MovedParameter(NamedTuple):
    """Values [SI] before and after; `moved` is the difference in half widths of the earlier interval, if any."""

    name: str
    unit: str
    before: float
    after: float
    moved: float | None


class ChangedError(NamedTuple):
    """Errors of a data set with the earlier and the new values; `rises` if it rises noticeably."""

    name: str
    role: Role
    before: ErrorSize
    after: ErrorSize
    rises: bool


class UpdateRecord(NamedTuple):
    """Record of an update.

    `optimiser`: stated by the user before any update; `gone`: missing data of the run; `prior`: whether the draws of
    the run replace them.
    """

    run: str
    optimiser: Mapping[str, Any]
    gone: tuple[str, ...]
    prior: bool
    new: tuple[NewData, ...]
    moved: tuple[MovedParameter, ...]
    errors: tuple[ChangedError, ...]
