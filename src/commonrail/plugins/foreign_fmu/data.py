"""Measured data for an FMU: simulations to run, and measured values of their outputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from commonrail.base.arguments import array, enum_member, plain_text, positive, settle
from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError
from commonrail.data.base import Role

StartValue = float | bool | str

SHARE = 0.01  # default tolerance, as a share of the range of the measured values


class FmuInputs(NamedTuple):
    """Courses of inputs: times (k,) [s] and values (k,) of each variable, linear in between."""

    times: Floats
    values: Mapping[str, Floats]


class Run(NamedTuple):
    """One simulation until `stop` [s]: values set before the initialization, and `outputs` at `times` (n,) [s]."""

    start: Mapping[str, StartValue]
    inputs: FmuInputs | None
    stop: float
    outputs: tuple[str, ...]
    times: Floats

    @property
    def size(self) -> int:
        """Number of output values."""
        return len(self.outputs) * len(self.times)


@dataclass(frozen=True, eq=False)
class FmuData:
    """A set of measured data.

    Attributes
    ----------
    name : str
    runs : tuple of Run
    measured : (m,)
        Ordered by run, output and time; in units of the FMU.
    tolerances : (m,)
        Error that counts as 1.
    role : Role
    weight : float
        Weight of the squares.
    source, synthetic : str
        Source of the data; note on synthetic data, empty if measured.
    """

    name: str
    runs: tuple[Run, ...]
    measured: Floats
    tolerances: Floats
    role: Role = Role.FIT
    weight: float = 1.0
    source: str = ""
    synthetic: str = ""
    bounds: ClassVar[None] = None  # values are not means over intervals

    def __post_init__(self) -> None:
        for what in ("name", "source", "synthetic"):
            plain_text(getattr(self, what), f"{what} of the data")
        weight, role = (
            positive("1")(self.weight, f"weight of {self.name}"),
            enum_member(self.role, Role, "role of the data"),
        )
        settle(self, role=role, weight=weight, measured=self.measured, tolerances=self.tolerances)
        if len(self.measured) != sum(run.size for run in self.runs):
            raise ConfigurationError(f"{self.name}: state one measured value for each output at each time.")
        if not (self.tolerances > 0.0).all():
            raise ConfigurationError(f"{self.name}: a tolerance must be greater than zero.")

    def residuals(self, values: Floats) -> Floats:
        """Simulated minus measured values (…, m), in tolerances."""
        return np.asarray((values - self.measured) / self.tolerances)

    def discrepancy(self, values: Floats) -> Floats:
        """Tolerances."""
        return self.tolerances


def by_set(data: Sequence[FmuData], values: Floats) -> list[Floats]:
    """Split values (…, all) of consecutive data sets into the values of each (…, m)."""
    return np.split(values, np.cumsum([len(data_set.measured) for data_set in data])[:-1], axis=-1)


def fmu_curve(
    name: str,
    times: ArrayLike,
    measured: Mapping[str, ArrayLike],
    *,
    tolerance: Mapping[str, float] | float | None = None,
    start: Mapping[str, StartValue] | None = None,
    inputs: FmuInputs | None = None,
    **more: Any,
) -> FmuData:
    """Make data of measured courses of outputs in one simulation.

    Parameters
    ----------
    name : str
    times : (n,)
        [s], increasing, none below 0.
    measured : mapping of str to (n,)
        Values of each output, in units of the FMU.
    tolerance : float or mapping of str to float, optional
        Error that counts as 1; default: `SHARE` of each output's range.
    start : mapping, optional
        Values set before the initialization.
    inputs : FmuInputs, optional
    **more
        Role, weight, source, synthetic.

    Raises
    ------
    ConfigurationError
        If lengths differ, times do not increase, or an output has no range and no tolerance.
    """
    at = array(times, "1", f"times of {name}", 1)
    if len(at) == 0 or at[0] < 0.0 or not (np.diff(at) > 0.0).all() or not at[-1] > 0.0:
        raise ConfigurationError(f"{name}: the times must increase from 0 or later; sort the rows.")
    columns = {output: array(column, "1", f"{output} of {name}", 1) for output, column in measured.items()}
    for output, column in columns.items():
        if len(column) != len(at):
            raise ConfigurationError(f"{name}: {output} has {len(column)} values for {len(at)} times.")
    run = Run(dict(start or {}), inputs, float(at[-1]), tuple(columns), at)
    tolerances = [
        np.full(len(column), _tolerance(name, output, column, tolerance)) for output, column in columns.items()
    ]
    return FmuData(name, (run,), np.concatenate(list(columns.values())), np.concatenate(tolerances), **more)


def fmu_rows(
    name: str,
    settings: Sequence[Mapping[str, StartValue]],
    measured: Mapping[str, ArrayLike],
    stop: float,
    *,
    tolerance: Mapping[str, float] | float | None = None,
    inputs: FmuInputs | None = None,
    **more: Any,
) -> FmuData:
    """Make data of measured values at the end of simulations, one per row.

    Parameters
    ----------
    name : str
    settings : sequence of mapping
        Values set before the initialization of each simulation.
    measured : mapping of str to (rows,)
        Values of each output at the end, in units of the FMU.
    stop : float
        End of each simulation [s].
    tolerance, inputs, **more
        As in `fmu_curve`.

    Raises
    ------
    ConfigurationError
        As `fmu_curve`.
    """
    columns = {output: array(column, "1", f"{output} of {name}", 1) for output, column in measured.items()}
    for output, column in columns.items():
        if len(column) != len(settings):
            raise ConfigurationError(f"{name}: {output} has {len(column)} values for {len(settings)} rows.")
    if not stop > 0.0:
        raise ConfigurationError(f"{name}: the end of the simulations must be greater than zero.")
    sizes = np.array([_tolerance(name, output, column, tolerance) for output, column in columns.items()])
    runs = tuple(Run(dict(start), inputs, stop, tuple(columns), np.array([stop])) for start in settings)
    table = np.column_stack(list(columns.values()))
    return FmuData(name, runs, table.ravel(), np.tile(sizes, len(settings)), **more)


def _tolerance(name: str, output: str, measured: Floats, tolerance: Mapping[str, float] | float | None) -> float:
    stated = tolerance.get(output) if isinstance(tolerance, Mapping) else tolerance
    if stated is not None:
        return float(stated)
    share_of_range = SHARE * float(np.ptp(measured))
    if not share_of_range > 0.0:
        raise ConfigurationError(f"{name}: all values of {output} are equal; state its tolerance.")
    return share_of_range
