"""Study of a foreign FMU: the model, measured data, free parameters and an optimiser."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from commonrail.arguments import chosen, instance, instances, mapping, number, plain_text, settle, whole
from commonrail.calibration.goal import Loss
from commonrail.calibration.optimisers import EvolutionSettings
from commonrail.calibration.parameter import Parameter
from commonrail.calibration.space import Space
from commonrail.calibration.study import Method
from commonrail.errors import ConfigurationError, InputError
from commonrail.foreign.data import FmuData
from commonrail.foreign.fmu import Fmu, FmuVariable, read_fmu
from commonrail.foreign.notes import notes_on
from commonrail.kinds import Role

__all__ = ["TIME_LIMIT", "FmuStudy", "fmu_study", "free_parameter"]

TIME_LIMIT = 60.0  # of one simulation [s]; far longer than one should take, so that a busy machine ends none
POLISH = 3  # refinements: as many as must agree before a search is called converged
EXAMPLE = '{"e": (0.5, 0.9)}'


@dataclass(frozen=True)
class FmuStudy:
    """A calibration of a foreign FMU, ready to run.

    Attributes
    ----------
    title : str
    fmu : Fmu
    data : tuple of FmuData
        At least one with role fit; their names differ.
    space : Space
        Free variables of the FMU, in its units.
    method : Method
    seed : int
    step : float
        Communication step [s].
    time_limit : float
        Time [s] after which the process of a simulation is ended.
    loss : Loss
        `Loss.SQUARES` or `Loss.SOFT_L1` of the residuals in tolerances.
    loss_scale : float
        Residual from which soft L1 grows in proportion.
    files : mapping of Path to str
        SHA-256 of each file that the study was read from, its own first; empty if it was made in Python.
    text, note : str
        The study file as given; free text for the report.

    Raises
    ------
    ConfigurationError
        If an argument is of another kind, no data set has role fit, two have one name, or a number is out of range.
    InputError
        If the FMU lacks a variable, has one of another kind, or does not allow a bound or a value.
    """

    title: str
    fmu: Fmu
    data: tuple[FmuData, ...]
    space: Space
    method: Method
    seed: int
    step: float
    time_limit: float = TIME_LIMIT
    loss: Loss = Loss.SQUARES
    loss_scale: float = 1.0
    files: Mapping[Path, str] = field(default_factory=dict)
    text: str = ""
    note: str = ""

    def __post_init__(self) -> None:
        for what in ("title", "text", "note"):
            plain_text(getattr(self, what), f"{what} of the study")
        instance(self.fmu, Fmu, "fmu of the study")
        instance(self.space, Space, "space of the study")
        instance(self.method, Method, "method of the study")
        settle(
            self,
            data=instances(self.data, FmuData, "data"),
            seed=whole(self.seed, "seed"),
            step=_positive(self.step, "step"),
            time_limit=_positive(self.time_limit, "time_limit"),
            loss=chosen(self.loss, Loss, "loss"),
            loss_scale=_positive(self.loss_scale, "loss_scale"),
        )
        if self.loss is Loss.KINDS:
            raise ConfigurationError(f'The loss of a study of an FMU is "squares" or "soft_l1", not "{self.loss}".')
        names = [one.name for one in self.data]
        if len(set(names)) < len(names):
            raise ConfigurationError("Two data sets of the study have one name; rename one.")
        if all(one.role is not Role.FIT for one in self.data):
            raise ConfigurationError(f"{self.title}: no data set has role fit; give at least one the role fit.")
        self._check_variables()

    @property
    def same_bits(self) -> bool:
        """Return False: the bits of a result are those of the FMU on this machine."""
        return False

    @property
    def synthetic(self) -> str:
        """Synthetic parts of the data, empty if there are none."""
        return " ".join(dict.fromkeys(one.synthetic for one in self.data if one.synthetic))

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on a step that is coarser than the data, and on inputs beyond the limits of the FMU."""
        return notes_on(self.fmu, self.data, self.step)

    def _refuse_outside(self, name: str, value: float, what: str) -> None:
        if found := self.fmu.outside(name, value, what):
            raise InputError(f"{self.fmu.path}: {found}; keep within what the FMU allows.")

    def _check_variables(self) -> None:
        for parameter in self.space.parameters:
            self.fmu.number(parameter.name)
            self.fmu.adjustable(parameter.name)
            self._refuse_outside(parameter.name, parameter.lower, "the lower bound")
            self._refuse_outside(parameter.name, parameter.upper, "the upper bound")
        for run in (run for one in self.data for run in one.runs):
            for output in run.outputs:
                self.fmu.number(output)
            for name, value in run.start.items():
                self.fmu.adjustable(name)
                if not isinstance(value, (bool, str)):
                    self._refuse_outside(name, value, "the value")
            for name in run.inputs.values if run.inputs else ():
                if self.fmu.number(name).causality != "input":
                    raise ConfigurationError(f"{self.fmu.path}: {name} is no input, so it has no course in time.")
            both = [name for name in self.space.names if name in run.start]
            if both:
                raise ConfigurationError(f"{both[0]} is free and set by the data as well; keep one of both.")
            driven = [name for name in self.space.names if run.inputs and name in run.inputs.values]
            if driven:
                raise ConfigurationError(f"{driven[0]} is free and has a measured course as well; keep one of both.")


def _positive(value: object, what: str) -> float:
    found = number(value, "1", what)
    if not found > 0.0:
        raise ConfigurationError(f"{what} must be greater than zero, not {found:g}.")
    return found


def fmu_study(
    fmu: Fmu | str | Path,
    data: FmuData | Sequence[FmuData],
    *,
    free: Mapping[str, Any],
    step: float,
    method: Method | None = None,
    seed: int = 1,
    title: str = "",
    time_limit: float = TIME_LIMIT,
    loss: Loss = Loss.SQUARES,
) -> FmuStudy:
    """Study of an FMU and measured data, ready for `calibrate_fmu`.

    Parameters
    ----------
    fmu : Fmu or path
    data : FmuData or sequence of FmuData
        At least one with role fit.
    free : mapping of str to (lower, upper)
        Bounds of variables by their names, in the units of the FMU; the search starts at the FMU's own values.
    step : float
        Communication step [s].
    method : Method, optional
        By default differential evolution and three least-squares refinements, ended when it has converged.
    seed : int
    title : str
        By default the model's name.
    time_limit : float
        Of one simulation [s].
    loss : Loss

    Raises
    ------
    ConfigurationError, InputError
        As `FmuStudy` and `read_fmu`.
    """
    model = fmu if isinstance(fmu, Fmu) else read_fmu(fmu)
    found = (data,) if isinstance(data, FmuData) else tuple(data)
    space = Space([_free(model, name, bounds) for name, bounds in mapping(free, "free", EXAMPLE).items()])
    usual = Method(EvolutionSettings(), POLISH, stop_when_converged=True)
    return FmuStudy(title or model.name, model, found, space, method or usual, seed, step, time_limit, loss)


def _free(fmu: Fmu, name: str, bounds: Any) -> Parameter:
    variable = fmu.number(name)
    if not isinstance(bounds, Sequence) or isinstance(bounds, str) or len(bounds) != 2:
        raise ConfigurationError(f"The bounds of {name} must be (lower, upper), not {bounds!r}.")
    lower, upper = (number(value, variable.known_unit, f"bound of {name}") for value in bounds)
    return free_parameter(variable, lower, upper)


def free_parameter(variable: FmuVariable, lower: float, upper: float, start: float | None = None) -> Parameter:
    """Free parameter of a variable.

    Parameters
    ----------
    variable : FmuVariable
    lower, upper : float
        Bounds in the unit of the FMU.
    start : float, optional
        By default the FMU's own value, or the middle of the bounds where it states none or one outside them.
    """
    own = _own(variable)
    inside = own is not None and lower <= own <= upper
    source = "start value of the FMU" if inside and start is None else "start value of the study"
    middle = 0.5 * (lower + upper)
    value = start if start is not None else own if own is not None and inside else middle
    return Parameter(variable.name, value, lower, upper, variable.unit, mark="E", source=source, signed=True)


def _own(variable: FmuVariable) -> float | None:
    try:
        found = float(variable.start or "nan")
    except ValueError:
        return None
    return found if math.isfinite(found) else None
