"""The check that what was kept of a calibrated injector is still what `task.calibrate_file` returns."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

__all__ = ["check_record"]

Count = Annotated[int, Field(ge=0)]


class _Part(BaseModel):
    model_config = ConfigDict(strict=True, allow_inf_nan=False, extra="forbid")


class _Costs(_Part):
    start: float | None
    best: float


class _Data(_Part):
    name: str
    role: str
    measure: str
    unit: str
    start: float | None
    best: float | None


class _Parameter(_Part):
    best: float
    standard_error: float | None
    verdict: str
    position: float
    at_bound: bool


class _Warning(_Part):
    code: str
    subject: str
    sentence: str


class _Record(_Part):
    seed: Count
    synthetic: str
    J: _Costs
    slots: Count
    simulated: Count
    failed: Count
    data: list[_Data]
    parameters: dict[str, _Parameter]
    warnings: list[_Warning] = []  # early journals have none


def check_record(record: Mapping[str, Any], data: Collection[str], parameters: Collection[str]) -> None:
    """Check a record that was read from a file.

    Parameters
    ----------
    record : mapping
    data, parameters : collection of str
        Names of the data sets that it may have, and of the parameters that it must have.

    Raises
    ------
    ValueError
        If it is not what a worker tells, or of other data or parameters.
    """
    found = _Record.model_validate(record)
    if not {part.name for part in found.data} <= set(data) or set(found.parameters) != set(parameters):
        raise ValueError("other data sets or parameters than the template's")
