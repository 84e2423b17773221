"""What a study is: an injector, measured data, free parameters, constraints, an objective and an optimiser."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from commonrail.calibration.optimisers.evolution_settings import EvolutionSettings
from commonrail.calibration.space import Space
from commonrail.engine.lanes import Precision
from commonrail.engine.operating_point import OperatingPoint
from commonrail.injector.definition import Injector

Floats = NDArray[np.float64]

# Marks a field that the fingerprint of a study leaves out, because studies of earlier versions did not have it.
LATER: Mapping[str, bool] = {"later": True}


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

    @property
    def synthetic(self) -> str:
        """What in the study is synthetic, empty if nothing is."""
        parts = [d.synthetic for d in self.data if d.synthetic]
        if self.injector.synthetic:
            parts.insert(0, self.injector.synthetic)
        return " ".join(dict.fromkeys(parts))
