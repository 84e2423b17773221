"""Study: an injector, measured data, free parameters, constraints, an objective and an optimiser."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any, cast

from commonrail.base.arguments import (
    Limits,
    amount,
    enum_member,
    flag,
    instance,
    instances,
    integer,
    mapping,
    number,
    plain_text,
    sequence,
    settle,
)
from commonrail.base.choices import Precision
from commonrail.base.display import Shown
from commonrail.base.errors import ConfigurationError, StudyError, nearest
from commonrail.calibration.objective import Goal, Loss, Objective, check_parts
from commonrail.calibration.optimisers.base import Settings
from commonrail.calibration.optimisers.evolution import EvolutionSettings
from commonrail.calibration.optimisers.registry import REGISTERED, registered
from commonrail.calibration.parameter import Condition, Mark, Parameter, Priors, percent_bounds
from commonrail.calibration.space import Space
from commonrail.data.base import DataSet, Role
from commonrail.data.metering import check_meters, list_meters
from commonrail.data.quantities.data import QuantityData, levels
from commonrail.data.registry import of_role
from commonrail.engine.time_step import (
    DEFAULT_STEP,
    TIME_STEPS,
    check_step,
    longest,
    medium_of,
    nice_step,
    stiffest_corner,
)
from commonrail.physics.injector import Injector
from commonrail.physics.meters import QUANTITIES, Meter, is_of_meter
from commonrail.readers.toml import UNSTATED

# Further searches by which a study's fit is judged.


class LeaveOut(StrEnum):
    """Quantity whose values are left out of the fit in turn."""

    RAIL_PRESSURE = "rail_pressure"
    ENERGISING_TIME = "energising_time"


@dataclass(frozen=True)
class Judgement:
    """Searches besides the one that gives the result.

    Parameters
    ----------
    seeds : int
        Searches with the next seeds, to see the spread of what they find.
    leave_out : tuple of LeaveOut
        For each value that the fitted maps have of these, a search without the rows at it, which are then predicted.

    Raises
    ------
    ConfigurationError
        If `seeds` is negative or has a fraction, or something else is to be left out.
    """

    seeds: int = 0
    leave_out: tuple[LeaveOut, ...] = ()

    def __post_init__(self) -> None:
        leave_out = tuple(
            dict.fromkeys(
                enum_member(by, LeaveOut, "leave_out")
                for by in sequence(self.leave_out, "leave_out", '["rail_pressure"]')
            )
        )
        settle(self, seeds=integer(self.seeds, "seeds of the judgement"), leave_out=leave_out)

    @property
    def has_searches(self) -> bool:
        """True if there is any further search."""
        return bool(self.seeds or self.leave_out)


NO_JUDGEMENT = Judgement()


SCALES = Limits(1e-6, 1e6)  # of the residual from which soft L1 grows in proportion


@dataclass(frozen=True)
class Method:
    """Settings of the optimisers.

    Attributes
    ----------
    evolution : Settings
        Of the first optimiser, which is the one that they belong to; by default the paper's differential evolution,
        (17)–(20).
    polish : int
        Least-squares refinements after it: a third from diverse members of its last population, the rest from hops
        near the best; 0 for none.
    polish_iterations : int
        Largest number of Jacobians of each refinement.
    stop_when_converged : bool
        End the first optimiser as soon as its population has collapsed and no longer gains. One that judges itself,
        such as the multi-start least squares, ends by itself either way.
    """

    evolution: Settings = field(default_factory=EvolutionSettings)
    polish: int = 0
    polish_iterations: int = 30
    stop_when_converged: bool = False

    def __post_init__(self) -> None:
        if registered(self.evolution) is None:
            instance(self.evolution, REGISTERED[0].settings, "evolution")
        settle(
            self,
            polish=integer(self.polish, "polish"),
            polish_iterations=integer(self.polish_iterations, "polish_iterations", 1),
            stop_when_converged=flag(self.stop_when_converged, "stop_when_converged"),
        )

    @property
    def is_evolution(self) -> bool:
        """True of the differential evolution without refinements: no LAPACK, whose bits depend on the processor."""
        return isinstance(self.evolution, EvolutionSettings) and not self.polish


@dataclass(frozen=True, repr=False)
class Study(Shown):
    """A calibration, ready to run.

    Attributes
    ----------
    title : str
    injector : Injector
        Start values: those of the injector's file ("theoretical" in the paper's study).
    data : tuple of DataSet
        At least one with role fit.
    space : Space
        Free parameters with bounds and constraints; names are dotted names of injector parameters.
    method : Method
    seed : int
    time_step : float
        [s].
    text : str
        The study file as given, to be kept with the result.
    note : str
        Free text for the report.
    precision : Precision
        Of the search. The scores of its result are simulated in f64.
    loss : Loss
        Loss on the data that the search makes small.
    loss_scale : float
        Residual [mm³/ms of a curve, tolerances of a map] from which the loss `Loss.SOFT_L1` grows in proportion.
    same_bits : bool
        Give the same result, bit for bit, on every x86-64 processor; at some cost of speed.
    conditions : tuple of Condition
        Behaviour that a candidate must have at operating points besides the data.
    judgement : Judgement
        Further searches by which the fit is judged; they do not change it.
    files : mapping of Path to str
        SHA-256 of each file that the study was read from, its own first; empty if it was made in Python.
    as_read : Study, optional
        The study as those files state it, by which a run tells what was changed in Python.
    author, logo : str
        For the report: a name, and a picture as a data URI; both may be empty.
    fixed : tuple of str
        Names of the values that the study states in place of the injector's; a type of injector keeps them.

    Raises
    ------
    ConfigurationError
        If an argument is of another kind, the seed is negative or has a fraction, the time step does not lie between
        1 ns and 100 us, a free parameter is neither the injector's nor a meter's, or a meter is described in two ways,
        leaves the fuel's range of temperature or has a free quantity that no data set sees.
    """

    presenter = "commonrail.report.notebook:STUDY"

    title: str
    injector: Injector
    data: tuple[DataSet, ...]
    space: Space
    method: Method
    seed: int
    time_step: float
    text: str = ""
    note: str = ""
    precision: Precision = Precision.F64
    loss: Loss = Loss.KINDS
    conditions: tuple[Condition, ...] = ()
    files: Mapping[Path, str] = field(default_factory=dict)
    same_bits: bool = False
    judgement: Judgement = NO_JUDGEMENT
    loss_scale: float = 1.0
    author: str = ""
    logo: str = ""
    fixed: tuple[str, ...] = ()
    as_read: Study | None = None

    def __post_init__(self) -> None:
        for what in ("title", "text", "note", "author", "logo"):
            plain_text(getattr(self, what), f"{what} of the study")
        instance(self.injector, Injector, "injector of the study")
        instance(self.judgement, Judgement, "judgement of the study")
        instance(self.method, Method, "method of the study")
        instance(self.space, Space, "space of the study")
        settle(
            self,
            data=instances(self.data, DataSet, "data"),  # type: ignore[type-abstract]
            seed=integer(self.seed, "seed"),
            time_step=check_step(self.time_step),
            precision=enum_member(self.precision, Precision, "precision"),
            loss=enum_member(self.loss, Loss, "loss"),
            loss_scale=amount(self.loss_scale, "1", "loss_scale", SCALES),
            same_bits=flag(self.same_bits, "same_bits"),
            conditions=instances(self.conditions, Condition, "conditions"),
            files=self.files,
            fixed=tuple(self.fixed),
        )
        self._check_names()
        self._check_judgement()
        check_parts(self.injector, self.data, self.conditions)
        check_meters(self.injector, self.data, {p.name: (p.lower, p.upper) for p in self.space.parameters})

    def _check_names(self) -> None:
        """Refuse a free parameter that neither the injector nor a meter of the data has."""
        meters = [name for meter in self.meters for name in map(meter.parameter, QUANTITIES)]
        for name in self.space.names:
            if name not in self.injector.values and name not in meters:
                raise ConfigurationError(
                    f"The space of the study has {name}, which is no parameter of the injector, and of no meter of "
                    f"the data{nearest(name, [*self.injector.values, *meters])}."
                )

    def _check_judgement(self) -> None:
        """Refuse rows to be left out where no fitted map has two values of them: they would be ignored in silence."""
        maps = [data for data in of_role(self.data, Role.FIT) if isinstance(data, QuantityData)]
        for by in self.judgement.leave_out:
            if not any(len(levels(data, by.value)) > 1 for data in maps):
                raise ConfigurationError(
                    f'judgement.leave_out names "{by.value}", and no map with role "fit" has rows at two or more '
                    "values of it; remove it, or fit a quantity map with more rows."
                )

    def objective(self, threads: int | None = None) -> Objective:
        """Objective that `calibrate` minimises, for a search of your own: data with role fit, priors and conditions.

        A point that breaks a bound or a constraint costs +inf. The result does not depend on `threads`, by default all
        usable processors. Raises `StudyError` if no data set has role fit.
        """
        return objective_of(self, threads, goal_of(self)._replace(space=self.space))

    @property
    def meters(self) -> tuple[Meter, ...]:
        """Meters of the data, each once."""
        return list_meters(self.data)

    @property
    def synthetic(self) -> str:
        """Synthetic parts of the study, empty if there are none."""
        parts = [d.synthetic for d in self.data if d.synthetic]
        if self.injector.synthetic:
            parts.insert(0, self.injector.synthetic)
        return " ".join(dict.fromkeys(parts))


# Study in one call: an injector, measured data and the bounds of the free parameters.

EXAMPLE = '{"valve.spring_preload": ("60 N", "95 N"), "nozzle.discharge_maximum": "10 %"}'
POLISH = 3  # refinements: as many as must agree before a search is called converged


def study(
    injector: Injector,
    data: DataSet | Sequence[DataSet],
    *,
    free: Mapping[str, Any],
    constraints: Sequence[str] = (),
    method: Method | None = None,
    seed: int = 1,
    title: str = "",
) -> Study:
    """Study of an injector and measured data, ready for `calibrate`.

    Parameters
    ----------
    injector : Injector
        Start values.
    data : DataSet or sequence of DataSet
        At least one with role fit.
    free : mapping of str to bounds
        By dotted name: lower and upper bound, SI or texts with units, or a share of the injector's value on either
        side, such as "10 %".
    constraints : sequence of str
        Such as "control_chamber.z_hole_diameter < control_chamber.a_hole_diameter".
    method : Method, optional
        By default differential evolution and three least-squares refinements, ended when it has converged.
    seed : int
    title : str
        By default the injector's name.

    Raises
    ------
    ConfigurationError
        If an argument is of another kind, a parameter is unknown, or bounds are crossed.
    """
    instance(injector, Injector, "injector")
    data_sets = instances([data] if isinstance(data, DataSet) else data, DataSet, "data")  # type: ignore[type-abstract]
    space = Space([_free(injector, *item) for item in mapping(free, "free", EXAMPLE).items()], constraints)
    usual = Method(EvolutionSettings(), POLISH, stop_when_converged=True)
    return Study(
        title or injector.name,
        injector,
        data_sets,
        space,
        usual if method is None else method,
        seed,
        step_for_all(injector, space),
    )


def _free(injector: Injector, name: str, bounds: Any) -> Parameter:
    if name not in injector.values:
        raise ConfigurationError(
            f"{injector.name} has no parameter {name}{nearest(name, injector.values)}; free is, for example, {EXAMPLE}."
        )
    unit, reference = injector.quantities[name].unit, injector.values[name]
    origin = injector.sources.get(name, UNSTATED)
    if isinstance(bounds, str) and bounds.strip().endswith("%"):
        share = number(bounds.strip().removesuffix("%"), "1", f"bounds of {name}")
        lower, upper = percent_bounds(reference, share, share, name)
    elif isinstance(bounds, Sequence) and not isinstance(bounds, str) and len(bounds) == 2:
        lower, upper = (number(value, unit, f"bound of {name}") for value in bounds)
    else:
        expected = f'(lower, upper) or a share such as "10 %", not {bounds!r}'
        raise ConfigurationError(f"The bounds of {name} must be {expected}.")
    return Parameter(name, reference, lower, upper, unit, mark=cast(Mark, origin.mark), source=origin.text)


# Time step of a study: short enough for every candidate within its bounds.


def longest_for_all(injector: Injector, space: Space) -> float:
    """Longest step [s] that every candidate within the bounds bears, at any pressure of the fuel's range."""
    lower, upper = (
        {name: value for name, value in zip(space.names, bound.tolist(), strict=True) if not is_of_meter(name)}
        for bound in (space.lower, space.upper)
    )
    corner = stiffest_corner(injector.values, lower, upper)
    return longest(injector.variant, corner, medium_of(injector, injector.fuel.pressure_range[1]))


def step_for_all(injector: Injector, space: Space) -> float:
    """Default step [s], or the largest round one that the stiffest corner of the bounds bears if that is shorter.

    Raises `ConfigurationError` if no step that the engines accept is short enough.
    """
    step = min(DEFAULT_STEP, nice_step(longest_for_all(injector, space)))
    if step < TIME_STEPS.low:
        raise ConfigurationError(
            "No time step is short enough for the stiffest parameters within the bounds; narrow the bounds of "
            "stiffnesses, masses, volumes and lengths, or check their units."
        )
    return step


# What a search minimises.

COARSEST_SCREENING = 1.5e-6  # time step [s] at which candidates are screened, if the stiffest of them bears it


def goal_of(study: Study) -> Goal:
    """Goal of a study's search."""
    step = min(max(COARSEST_SCREENING, study.time_step), nice_step(longest_for_all(study.injector, study.space)))
    priors, screening = Priors.of(study.space.parameters), max(step, study.time_step)
    return Goal(study.loss, priors, study.conditions, screening, study.loss_scale)


def objective_of(study: Study, threads: int | None, goal: Goal | None = None) -> Objective:
    """Objective of a study's fit data, by default with its goal; `StudyError` if it has none."""
    what = study.injector, study.space.names, fitted_data(study), study.time_step, threads, study.precision
    return Objective(*what, goal=goal or goal_of(study), same_bits=study.same_bits)


def fitted_data(study: Study) -> list[DataSet]:
    """Data of a study with role fit; `StudyError` if there are none."""
    if fit := of_role(study.data, Role.FIT):
        return fit
    raise StudyError(f"{study.title}: no data set has role fit; give at least one the role fit.")
