"""Outputs of a sensitivity study as functions of the parameters: features of an injector, and J of a study."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from commonrail.analysis.sensitivity.features import STEADY, Codes, Feature, codes_of, steady_rates
from commonrail.arrays import Floats
from commonrail.calibration.objective import Objective
from commonrail.choices import Precision
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.plan import prepare
from commonrail.engine.simulate import simulate_batch
from commonrail.engine.solution import Batch
from commonrail.engine.status import OK
from commonrail.injector.definition import Injector
from commonrail.units import to_text

__all__ = ["Computing", "Evaluated", "Features", "Joined", "Model", "Misfits", "Output", "point_text"]


class Output(NamedTuple):
    """Quantity whose sensitivity is asked for: name, SI unit, meaning, and operating point as text, if it has one."""

    name: str
    unit: str
    meaning: str
    point: str = ""


class Evaluated(NamedTuple):
    """Values (candidates, outputs) of candidates, NaN where there is none, and their codes, OK where there is one."""

    values: Floats
    codes: Codes


class Computing(NamedTuple):
    """Time step [s], threads (all usable processors if None) and precision of the simulations."""

    time_step: float
    threads: int | None = None
    precision: Precision = Precision.F64


class Model(Protocol):
    """Outputs of candidates."""

    @property
    def outputs(self) -> tuple[Output, ...]:
        """Outputs in order."""

    @property
    def injections(self) -> int:
        """Single injections that a candidate takes."""

    def evaluate(self, values: Floats) -> Evaluated:
        """Outputs of candidates (n, parameters) [SI]."""


def point_text(point: OperatingPoint) -> str:
    """Rail pressure and energising times of a point."""
    rail = to_text(point.at_start(point.rail_pressure), "Pa", 4)
    return f"{rail}, {' + '.join(to_text(pulse.duration, 's', 4) for pulse in point.pulses)}"


class Features:
    """Features of an injector at operating points.

    Parameters
    ----------
    injector : Injector
        Gives the values that do not vary.
    names : sequence of str
        Columns of the candidates; those that are no parameters of the injector, such as a meter's, are ignored.
    points : sequence of OperatingPoint
    features : sequence of Feature
    computing : Computing
    """

    def __init__(
        self,
        injector: Injector,
        names: Sequence[str],
        points: Sequence[OperatingPoint],
        features: Sequence[Feature],
        computing: Computing,
    ) -> None:
        self.injector, self.points, self.features, self.computing = injector, tuple(points), tuple(features), computing
        self._columns = [i for i, name in enumerate(names) if name in injector.values]
        self._names = tuple(names[i] for i in self._columns)
        dt = computing.time_step
        self._ordinary = any(feature.name != STEADY for feature in features)
        self._prepared = prepare(injector, self.points, dt)
        self._steady = [steady_rates(p, dt) for p in points] if any(f.name == STEADY for f in features) else []
        self._steady_prepared = [prepare(injector, [short], dt) for short, _ in self._steady]

    @property
    def outputs(self) -> tuple[Output, ...]:
        """Features of the first point, then those of the next."""
        return tuple(Output(f.name, f.unit, f.meaning, point_text(p)) for p in self.points for f in self.features)

    @property
    def injections(self) -> int:
        """Simulations of a candidate; one that ends with energising counts too."""
        return len(self.points) * self._ordinary + len(self._steady)

    def evaluate(self, values: Floats) -> Evaluated:
        """As `Model`."""
        own = np.ascontiguousarray(values[:, self._columns])
        whole = self._batch(self.points, own, self._prepared) if self._ordinary else None
        found, codes = [], []
        for k, point in enumerate(self.points):
            short = self._at_steady(k, own) if self._steady else None
            for feature in self.features:
                batch = short if feature.name == STEADY else whole and whole.at_points(slice(k, k + 1))
                assert batch is not None
                figures = feature.of(batch, point)
                code = codes_of(feature, figures, batch.status[:, 0])
                found.append(np.where(code == OK, figures, np.nan))
                codes.append(code)
        return Evaluated(np.stack(found, axis=1), np.stack(codes, axis=1))

    def _at_steady(self, k: int, values: Floats) -> Batch:
        short, misfit = self._steady[k]
        return self._batch([short], values, self._steady_prepared[k], misfit)

    def _batch(
        self, points: Sequence[OperatingPoint], values: Floats, prepared: object, misfit: object = None
    ) -> Batch:
        step, threads, precision = self.computing
        return simulate_batch(
            self.injector,
            points,
            self._names,
            values,
            time_step=step,
            threads=threads,
            misfit=misfit,  # type: ignore[arg-type]
            precision=precision,
            prepared=prepared,  # type: ignore[arg-type]
        )


class Misfits:
    """J of a study."""

    def __init__(self, objective: Objective) -> None:
        self.objective = objective

    @property
    def outputs(self) -> tuple[Output, ...]:
        """J alone."""
        return (Output("J", "1", "objective of the study"),)

    @property
    def injections(self) -> int:
        """Points of the data and of the conditions."""
        return self.objective.injections

    def evaluate(self, values: Floats) -> Evaluated:
        """As `Model`."""
        scores = self.objective.costs(values)
        codes = scores.statuses.astype(np.int8)
        return Evaluated(np.where(codes == OK, scores.costs, np.nan)[:, None], codes[:, None])


class Joined:
    """Outputs of several models side by side."""

    def __init__(self, models: Sequence[Model]) -> None:
        self.models = tuple(models)

    @property
    def outputs(self) -> tuple[Output, ...]:
        """Of all models, in order."""
        return tuple(output for model in self.models for output in model.outputs)

    @property
    def injections(self) -> int:
        """Sum over the models."""
        return sum(model.injections for model in self.models)

    def evaluate(self, values: Floats) -> Evaluated:
        """As `Model`."""
        found = [model.evaluate(values) for model in self.models]
        return Evaluated(np.hstack([f.values for f in found]), np.hstack([f.codes for f in found]))
