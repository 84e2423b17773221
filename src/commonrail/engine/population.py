"""From the values that a user gives for many candidates to their full parameter vectors."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from commonrail.arguments import array, sequence
from commonrail.arrays import Bools, Floats, IndexArray
from commonrail.choices import Actuation
from commonrail.engine.block import FUEL
from commonrail.errors import ConfigurationError
from commonrail.fuel.coefficients import coefficient_rows
from commonrail.fuel.fuel import Fuel
from commonrail.injector.definition import FUEL_TEMPERATURE, Injector, parameter_paths, parameter_quantities
from commonrail.parts.furniture import Domain


def read_candidates(names: Sequence[str], values: ArrayLike | None) -> Floats:
    """Values (candidates, names) as SI numbers; text is read in the unit of its own column."""
    if values is None:
        candidates = np.empty((1, 0))
    elif isinstance(values, np.ndarray) and values.dtype.kind in "iuf":
        candidates = np.atleast_2d(np.asarray(values, float))
    else:
        candidates = _read_rows(names, values)
    if candidates.ndim != 2 or candidates.shape[1] != len(names):
        raise ConfigurationError(
            f"{len(names)} names but {candidates.shape[-1]} values a candidate were given: the values must have a row "
            "for each candidate and in it one value for each name, such as [[1e-3], [2e-3]] for one name."
        )
    if not len(candidates):
        raise ConfigurationError("At least one candidate is needed among the values.")
    return candidates


def _read_rows(names: Sequence[str], values: Any) -> Floats:
    rows = sequence(values, "values", "[[1e-3], [2e-3]], a row for each candidate")
    if not any(isinstance(row, Sequence | np.ndarray) and not isinstance(row, str) for row in rows):
        rows = [rows]
    known = parameter_quantities()
    read = []
    for i, row in enumerate(rows, start=1):
        what = f"values of candidate {i}"
        items = sequence(row, what, "[1e-3]")
        if len(items) != len(names):
            raise ConfigurationError(f"{len(names)} names but {len(items)} {what} were given; give one for each name.")
        read.append(
            [
                float(array(item, known[name].unit, f"{what}, {name}", 0, finite=False))
                for item, name in zip(items, names, strict=True)
            ]
        )
    return np.reshape(read, (len(read), len(names))).astype(float)


def candidate_matrix(injector: Injector, names: Sequence[str], values: Floats, row: Floats | None = None) -> Floats:
    """Full parameter vectors of candidates: (candidates, parameters + fuel coefficients).

    Parameters
    ----------
    injector : Injector
        Gives the values that do not vary.
    names : sequence of str
        Dotted names of the values that vary; "fuel.temperature" may be among them.
    values : (candidates, names)
        SI values.
    row : (parameters + fuel coefficients,), optional
        The injector's own full vector, known already.
    """
    if row is not None and FUEL_TEMPERATURE not in names:
        theta = np.empty((len(values), len(row)))
        theta[:] = row
        theta[:, columns(tuple(names), injector.variant.actuation)] = values
        return theta
    paths = parameter_paths(injector.variant.actuation)
    theta = np.empty((len(values), len(paths) + len(FUEL.paths)))
    theta[:, : len(paths)] = [injector.values[path] for path in paths]
    temperature = np.full(len(values), injector.values[FUEL_TEMPERATURE])
    for column, name in enumerate(names):
        if name == FUEL_TEMPERATURE:
            temperature = values[:, column]
        else:
            theta[:, paths.index(name)] = values[:, column]
    distinct, which = np.unique(temperature, return_inverse=True)
    fuels = coefficient_rows(injector.fuel, tuple(distinct.tolist()))
    theta[:, len(paths) :] = fuels[which]
    return theta


@functools.lru_cache(maxsize=64)
def columns(names: tuple[str, ...], actuation: Actuation = Actuation.SERVO) -> IndexArray:
    """Positions of parameters in a full vector of an actuation."""
    paths = parameter_paths(actuation)
    return np.array([paths.index(name) for name in names], np.intp)


def admissible(names: Sequence[str], values: Floats, fuel: Fuel | None = None) -> Bools:
    """True for candidates in the domain of their parameters, and in the fuel's range of temperature: (candidates,).

    Parameters
    ----------
    names, values
        As in `candidate_matrix`.
    fuel : Fuel, optional
        Its range of temperature is not asked where it is left out.
    """
    inside = np.isfinite(values)
    if fuel is not None and FUEL_TEMPERATURE in names:
        column = list(names).index(FUEL_TEMPERATURE)
        inside[:, column] &= fuel.defined_at(values[:, column])
    for domain, where in _domains(tuple(names)):
        inside[:, where] &= domain.admits(values[:, where])
    return np.asarray(inside.all(axis=1))


@functools.lru_cache(maxsize=64)
def _domains(names: tuple[str, ...]) -> list[tuple[Domain, list[int] | slice]]:
    """Domains of parameters, and the places of those that lie in each."""
    known = parameter_quantities()
    found: dict[Domain, list[int]] = {}
    for column, name in enumerate(names):
        found.setdefault(known[name].domain, []).append(column)
    if len(found) == 1:
        return [(domain, slice(None)) for domain in found]
    return list(found.items())
