"""What a study is: an injector, measured data, free parameters, constraints, an objective and an optimiser."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from commonrail.arguments import (
    Limits,
    amount,
    array,
    chosen,
    flag,
    instance,
    instances,
    number,
    plain_text,
    settle,
    whole,
)
from commonrail.calibration.optimisers.evolution_settings import EvolutionSettings
from commonrail.calibration.space import Space
from commonrail.engine.lanes import Precision
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.time_step import check_step
from commonrail.errors import ConfigurationError, nearest
from commonrail.injector.definition import Injector

Floats = NDArray[np.float64]

# Marks a field that the fingerprint of a study leaves out, because studies of earlier versions did not have it.
LATER: Mapping[str, bool] = {"later": True}


TOLERANCES = Limits(1e-18, 1.0, (1e-12, 1e-6), ("mm3",))  # of a quantity per stroke [m3]


class Role(Enum):
    """What a data set is used for."""

    FIT = "fit"
    VALIDATION = "validation"


@dataclass(frozen=True)
class RateData:
    """A measured injection curve (EVI) at one operating point.

    Attributes
    ----------
    name : str
    role : Role
    point : OperatingPoint
        Its horizon ends at or after the last bound.
    bounds : (samples + 1,)
        Bounds of the samples that count [s]; a sample is the mean flow between two bounds.
    rate : (samples,)
        Measured rate of injection by volume [m³/s].
    weight : float
        Factor of its J in the objective.
    source, synthetic : str
        Where the data come from; what about them is synthetic, empty if measured.
    mass_density : float
        Density [kg/m³] that made a volume of a rate measured by mass, and makes one of the simulated rate: masses are
        compared with masses. NaN for a rate measured by volume, which is compared at each candidate's own density.

    Raises
    ------
    ConfigurationError
        If an argument is of another kind, the bounds do not increase, or there is not one rate between each two.
    """

    name: str
    role: Role
    point: OperatingPoint
    bounds: Floats
    rate: Floats
    weight: float
    source: str
    synthetic: str
    mass_density: float = field(default=math.nan, metadata=LATER)

    def __post_init__(self) -> None:
        _settle_labels(self)
        instance(self.point, OperatingPoint, "point of the data")
        bounds, rate = array(self.bounds, "s", "bounds of the data", 1), array(self.rate, "m3/s", "rate of the data", 1)
        if len(bounds) != len(rate) + 1 or not len(rate):
            raise ConfigurationError(
                f"The bounds of {self.name} must be one more than its rates, and {len(bounds)} bounds and {len(rate)} "
                "rates were given."
            )
        if not np.all(np.diff(bounds) > 0.0):
            raise ConfigurationError(f"The bounds of {self.name} must increase from sample to sample.")
        settle(self, bounds=bounds, rate=rate)


@dataclass(frozen=True)
class QuantityData:
    """Measured quantities per stroke at several operating points (a map).

    Attributes
    ----------
    name : str
    role : Role
    points : tuple of OperatingPoint, length n
    quantity : (n,)
        Injected quantity per stroke by volume [m³].
    absolute, relative : float
        Tolerances: an error is judged against absolute [m³] + relative × quantity.
    dead_time : (n,) bool
        Rows that state the energising time at which the given small quantity is reached.
    weight : float
    source, synthetic : str
    mass_density : float or (n,)
        As in `RateData`, of each quantity.

    Raises
    ------
    ConfigurationError
        If an argument is of another kind, or points, quantities and dead times are not of one number.
    """

    name: str
    role: Role
    points: tuple[OperatingPoint, ...]
    quantity: Floats
    absolute: float
    relative: float
    dead_time: NDArray[np.bool_]
    weight: float
    source: str
    synthetic: str
    mass_density: Floats | float = field(default=math.nan, metadata=LATER)

    def __post_init__(self) -> None:
        _settle_labels(self)
        points = instances(self.points, OperatingPoint, "points of the data")
        quantity = array(self.quantity, "m3", "quantity of the data", 1)
        dead_time = np.array([flag(item, "dead_time") for item in np.ravel(self.dead_time)], bool)
        if not len(points) == len(quantity) == len(dead_time):
            raise ConfigurationError(
                f"{self.name} must have as many points as quantities and marks of dead times, not {len(points)}, "
                f"{len(quantity)} and {len(dead_time)}."
            )
        settle(
            self,
            points=points,
            quantity=quantity,
            absolute=amount(self.absolute, "m3", "absolute tolerance", TOLERANCES),
            relative=amount(self.relative, "1", "relative tolerance", Limits(0.0, 1e6)),
            dead_time=dead_time,
        )


def _settle_labels(data: RateData | QuantityData) -> None:
    """Read what both kinds of data have."""
    for what in ("name", "source", "synthetic"):
        plain_text(getattr(data, what), f"{what} of the data")
    weight = number(data.weight, "1", "weight of the data")
    if not weight > 0.0:
        raise ConfigurationError(f"The weight of {data.name} must be greater than zero, not {weight:g}.")
    settle(data, role=chosen(data.role, Role, "role of the data"), weight=weight)


@dataclass(frozen=True)
class Method:
    """Settings of the optimiser.

    Attributes
    ----------
    evolution : EvolutionSettings
        The paper's differential evolution, (17)–(20).
    polish : int
        Least-squares refinements after the evolution: a third from diverse members of the last population, the rest
        from hops near the best; 0 for none.
    polish_iterations : int
        Largest number of Jacobians of each refinement.
    """

    evolution: EvolutionSettings = EvolutionSettings()
    polish: int = 0
    polish_iterations: int = 30

    def __post_init__(self) -> None:
        instance(self.evolution, EvolutionSettings, "evolution")
        settle(
            self,
            polish=whole(self.polish, "polish"),
            polish_iterations=whole(self.polish_iterations, "polish_iterations", 1),
        )


@dataclass(frozen=True)
class Study:
    """A calibration, ready to run.

    Attributes
    ----------
    title : str
    injector : Injector
        Start values: those of the injector's file ("theoretical" in the paper's study).
    data : tuple of RateData or QuantityData
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
    files : mapping of Path to str
        SHA-256 of each file that the study was read from, its own first; empty if it was made in Python.

    Raises
    ------
    ConfigurationError
        If an argument is of another kind, the seed is negative or has a fraction, the time step does not lie between
        1 ns and 100 us, or a free parameter is not the injector's.
    """

    title: str
    injector: Injector
    data: tuple[RateData | QuantityData, ...]
    space: Space
    method: Method
    seed: int
    time_step: float
    text: str = ""
    note: str = ""
    precision: Precision = Precision.F64
    files: Mapping[Path, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for what in ("title", "text", "note"):
            plain_text(getattr(self, what), f"{what} of the study")
        instance(self.injector, Injector, "injector of the study")
        instance(self.method, Method, "method of the study")
        instance(self.space, Space, "space of the study")
        for name in self.space.names:
            if name not in self.injector.values:
                raise ConfigurationError(
                    f"The space of the study has {name}, which is no parameter of the injector"
                    f"{nearest(name, self.injector.values)}."
                )
        settle(
            self,
            data=instances(self.data, RateData | QuantityData, "data"),
            seed=whole(self.seed, "seed"),
            time_step=check_step(self.time_step),
            precision=chosen(self.precision, Precision, "precision"),
        )

    @property
    def synthetic(self) -> str:
        """What in the study is synthetic, empty if nothing is."""
        parts = [d.synthetic for d in self.data if d.synthetic]
        if self.injector.synthetic:
            parts.insert(0, self.injector.synthetic)
        return " ".join(dict.fromkeys(parts))
