"""Outputs of a sensitivity study, and the ranges of its parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.base.arguments import (
    Quantity,
    instance,
    known_names,
    mapping,
    number,
)
from commonrail.base.arrays import Floats, Ints
from commonrail.base.choices import Precision
from commonrail.base.errors import ConfigurationError
from commonrail.base.units import to_text
from commonrail.calibration.objective import Objective
from commonrail.calibration.parameter import Parameter
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.plan import prepare
from commonrail.engine.simulate import simulate_batch
from commonrail.engine.solution import Batch
from commonrail.engine.status import OK, STILL_INJECTING, Status
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector, parameter_quantities
from commonrail.physics.law import Domain
from commonrail.physics.variants import unread_parameters
from commonrail.plugins.features.table import Feature, features_of_simulations

Codes = NDArray[np.int8]
NO_EVENT = -1  # code of a missing feature: the needle never opens, or never closes
DEFAULT_FEATURES = ("quantity", "opening_delay", "closing_delay", "duration", "steady_rate")


def read_features(names: Sequence[str]) -> tuple[Feature, ...]:
    """Read features by name; `ConfigurationError` for an unknown or repeated one."""
    available = features_of_simulations()
    return tuple(available[name] for name in known_names(names, available, "features", "quantity"))


def make_codes(feature: Feature, values: Floats, statuses: Ints) -> Codes:
    """Code of each value (candidates,): OK if usable, else the status of its simulation or `NO_EVENT`."""
    usable = (statuses == OK) | ((statuses == STILL_INJECTING) & (not feature.final))
    return np.where(usable, np.where(np.isfinite(values), OK, NO_EVENT), statuses).astype(np.int8)


def reason(code: int) -> str:
    """Sentence on the reason for a missing value."""
    return "The needle does not open, or does not close." if code == NO_EVENT else Status(code).sentence


# Outputs of a sensitivity study as functions of the parameters: features of an injector, and J of a study.


class Output(NamedTuple):
    """Output of a sensitivity study: name, SI unit, meaning, and operating point as text, if it has one."""

    name: str
    unit: str
    meaning: str
    point: str = ""


class Evaluated(NamedTuple):
    """Values (candidates, outputs) of candidates, NaN if absent, and their codes, OK if present."""

    values: Floats
    codes: Codes


class Computing(NamedTuple):
    """Time step [s], threads (all usable processors if None) and precision of the simulations."""

    time_step: float
    threads: int | None = None
    precision: Precision = Precision.F64


class Model(NamedTuple):
    """Outputs in order, number of single injections per candidate, and the outputs of candidates.

    Candidates are (n, parameters) [SI].
    """

    outputs: tuple[Output, ...]
    injections: int
    evaluate: Callable[[Floats], Evaluated]


def point_text(point: OperatingPoint) -> str:
    """Rail pressure and energising times of a point."""
    rail = to_text(point.at_start(point.rail_pressure), "Pa", 4)
    return f"{rail}, {' + '.join(to_text(pulse.duration, 's', 4) for pulse in point.pulses)}"


class Features:
    """Features of an injector at operating points.

    Parameters
    ----------
    injector : Injector
        Gives the fixed values.
    names : sequence of str
        Columns of the candidates; names that are not parameters of the injector, such as a meter's, are ignored.
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
        self.injector, self.computing = injector, computing
        self.points, self.features = tuple(points), tuple(features)
        self._columns = [i for i, name in enumerate(names) if name in injector.values]
        self._names = tuple(names[i] for i in self._columns)
        dt = computing.time_step
        self._ordinary = any(feature.own_simulation is None for feature in features)
        self._prepared = prepare(injector, self.points, dt)
        self._own = {
            (f.name, k): f.own_simulation(p, dt) for f in features if f.own_simulation for k, p in enumerate(points)
        }
        self._own_prepared = {key: prepare(injector, [point], dt) for key, (point, _) in self._own.items()}

    @property
    def model(self) -> Model:
        """Features of each point in turn; the number of simulations includes extra simulations of features."""
        outputs = (Output(f.name, f.unit, f.meaning, point_text(p)) for p in self.points for f in self.features)
        return Model(tuple(outputs), len(self.points) * self._ordinary + len(self._own), self.evaluate)

    def evaluate(self, values: Floats) -> Evaluated:
        """Features of candidates (n, parameters) [SI]."""
        columns = np.ascontiguousarray(values[:, self._columns])
        shared_batch = self._batch(self.points, columns, self._prepared) if self._ordinary else None
        results, codes = [], []
        for k, point in enumerate(self.points):
            for feature in self.features:
                key = feature.name, k
                batch = (
                    self._of_its_own(key, columns)
                    if key in self._own
                    else shared_batch and shared_batch.at_points(slice(k, k + 1))
                )
                assert batch is not None
                assert feature.of_simulation is not None
                figures = feature.of_simulation(batch, point)
                code = make_codes(feature, figures, batch.status[:, 0])
                results.append(np.where(code == OK, figures, np.nan))
                codes.append(code)
        return Evaluated(np.stack(results, axis=1), np.stack(codes, axis=1))

    def _of_its_own(self, key: tuple[str, int], values: Floats) -> Batch:
        """Extra simulation of a feature; `key`: name of the feature and index of the point."""
        point, misfit = self._own[key]
        return self._batch([point], values, self._own_prepared[key], misfit)

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


def misfit_model(objective: Objective) -> Model:
    """J of a study."""

    def evaluate(values: Floats) -> Evaluated:
        scores = objective.costs(values)
        codes = scores.statuses.astype(np.int8)
        return Evaluated(np.where(codes == OK, scores.costs, np.nan)[:, None], codes[:, None])

    return Model((Output("J", "1", "objective of the study"),), objective.injections, evaluate)


def join_models(models: Sequence[Model]) -> Model:
    """Outputs of several models side by side."""

    def evaluate(values: Floats) -> Evaluated:
        parts = [model.evaluate(values) for model in models]
        return Evaluated(np.hstack([f.values for f in parts]), np.hstack([f.codes for f in parts]))

    outputs = tuple(output for model in models for output in model.outputs)
    return Model(outputs, sum(model.injections for model in models), evaluate)


WITHIN = 0.05  # half width of a range about the value, as a share of it
COUNTED = ("nozzle.holes", "solenoid.turns", "solenoid.air_gaps")  # whole numbers: they have no tolerance


def default_names(injector: Injector) -> tuple[str, ...]:
    """Parameters that a study varies by default: all that are read, except zeros, counts and temperature."""
    unread = unread_parameters(injector.variant)
    return tuple(
        name
        for name, value in injector.values.items()
        if value != 0.0 and name not in COUNTED and name != FUEL_TEMPERATURE and name not in unread
    )


def parameters_within(
    injector: Injector,
    names: Sequence[str] | None = None,
    within: Quantity = WITHIN,
    ranges: Mapping[str, tuple[Quantity, Quantity]] | None = None,
) -> tuple[Parameter, ...]:
    """Make parameters of an injector with ranges for a sensitivity study.

    Parameters
    ----------
    injector : Injector
        Its values are the references.
    names : sequence of str, optional
        Dotted names; default without `ranges`: all parameters except zeros, counts and the fuel temperature.
    within : float or str
        Half width of a range as a share of the value, such as 0.05 or "5 %"; cut at the end of a parameter's
        domain.
    ranges : mapping of str to (low, high), optional
        Individual ranges, SI or text with units; their names need not be among `names`.

    Raises
    ------
    ConfigurationError
        If a name is unknown or not read by the injector's variant, a value is zero and has no range, or a range is
        crossed or leaves the domain.
    """
    instance(injector, Injector, "injector")
    stated_ranges = mapping(ranges or {}, "ranges", '{"valve.lift": ("50 um", "60 um")}')
    share = number(within, "1", "share of the ranges")
    if not 0.0 < share <= 1.0:
        raise ConfigurationError(f"The share of the ranges must be greater than 0 and at most 1, not {share:g}.")
    if names is None:
        names = () if stated_ranges else default_names(injector)
    quantities = parameter_quantities()
    selected = dict.fromkeys(known_names(names, quantities, "names", "valve.lift"))
    selected |= dict.fromkeys(known_names([*stated_ranges], quantities, "names of ranges", "valve.lift"))
    injector.check_read(selected)
    if not selected:
        raise ConfigurationError("At least one parameter is needed among the names.")
    return tuple(_read_range(injector, name, stated_ranges.get(name), share) for name in selected)


def _read_range(injector: Injector, name: str, ends: object, share: float) -> Parameter:
    quantity, value = parameter_quantities()[name], injector.values[name]
    if ends is None:
        if value == 0.0:
            raise ConfigurationError(
                f"{name} is zero in {injector.name}, and a share of zero is not a range; give low and high."
            )
        low, high = sorted((value * (1.0 - share), value * (1.0 + share)))
        if quantity.domain in (Domain.COEFFICIENT, Domain.UNIT):
            high = min(high, 1.0)
    else:
        pair = ends if isinstance(ends, tuple | list) and len(ends) == 2 else None
        if pair is None:
            raise ConfigurationError(f'The range of {name} must be a pair, such as ("50 um", "60 um").')
        low, high = (number(end, quantity.unit, f"range of {name}") for end in pair)
    if not (quantity.domain.admits(low) and quantity.domain.admits(high)):
        raise ConfigurationError(
            f"The range of {name}, {low:g} to {high:g} {quantity.unit}, must lie in its domain: "
            f"{quantity.domain.value}."
        )
    source = f"±{share:.3g} of the value" if ends is None else "range of the sensitivity study"
    return Parameter(name, value, low, high, quantity.unit, mark="E", source=source, signed=True)
