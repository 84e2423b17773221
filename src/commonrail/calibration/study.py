"""Study: an injector, measured data, free parameters, constraints, an objective and an optimiser."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from commonrail.arguments import Limits, amount, chosen, flag, instance, instances, plain_text, settle, whole
from commonrail.calibration.conditions import Condition
from commonrail.calibration.goal import Loss
from commonrail.calibration.judgement import NO_JUDGEMENT, Judgement
from commonrail.calibration.optimisers import EvolutionSettings, Settings
from commonrail.calibration.optimisers.registry import REGISTERED, registered
from commonrail.calibration.space import Space
from commonrail.choices import Precision
from commonrail.display.shown import Shown
from commonrail.engine.time_step import check_step
from commonrail.errors import ConfigurationError, nearest
from commonrail.injector.definition import Injector
from commonrail.kinds import ANY_KIND, DataSet, QuantityData, Role, of_role
from commonrail.kinds.maps.folds import levels
from commonrail.kinds.metering import check_meters, meters_of
from commonrail.observation.meter import Meter
from commonrail.observation.quantities import QUANTITIES

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
            polish=whole(self.polish, "polish"),
            polish_iterations=whole(self.polish_iterations, "polish_iterations", 1),
            stop_when_converged=flag(self.stop_when_converged, "stop_when_converged"),
        )


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

    presenter = "commonrail.report.faces:STUDY"

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

    def __post_init__(self) -> None:
        for what in ("title", "text", "note", "author", "logo"):
            plain_text(getattr(self, what), f"{what} of the study")
        instance(self.injector, Injector, "injector of the study")
        instance(self.judgement, Judgement, "judgement of the study")
        instance(self.method, Method, "method of the study")
        instance(self.space, Space, "space of the study")
        settle(
            self,
            data=instances(self.data, ANY_KIND, "data"),
            seed=whole(self.seed, "seed"),
            time_step=check_step(self.time_step),
            precision=chosen(self.precision, Precision, "precision"),
            loss=chosen(self.loss, Loss, "loss"),
            loss_scale=amount(self.loss_scale, "1", "loss_scale", SCALES),
            same_bits=flag(self.same_bits, "same_bits"),
            conditions=instances(self.conditions, Condition, "conditions"),
        )
        self._check_names()
        self._check_judgement()
        check_meters(self.injector, self.data, self.space)

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

    @property
    def meters(self) -> tuple[Meter, ...]:
        """Meters of the data, each once."""
        return meters_of(self.data)

    @property
    def synthetic(self) -> str:
        """Synthetic parts of the study, empty if there are none."""
        parts = [d.synthetic for d in self.data if d.synthetic]
        if self.injector.synthetic:
            parts.insert(0, self.injector.synthetic)
        return " ".join(dict.fromkeys(parts))
