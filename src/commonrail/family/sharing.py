"""Parameters of parts that are fitted together: what is common, what is each part's own, what scatters about a mean."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from commonrail.arrays import Floats
from commonrail.calibration.parameter import Parameter
from commonrail.calibration.prior import Prior
from commonrail.calibration.products import Products
from commonrail.calibration.space import Space
from commonrail.errors import ConfigurationError, nearest

__all__ = ["OF", "Share", "Shared", "Sharing", "joint_space"]


OF = " of part "  # between a parameter and the part whose own it is
WIDEST = 4.0  # standard deviations that a part may lie from the common value


class Share(StrEnum):
    """Relation of a parameter between the parts of a family."""

    COMMON = "common"
    """One value for all parts."""

    PER_PART = "per part"
    """A value for each part, independent of the others'."""

    AROUND = "around"
    """A value for each part, normally distributed about a common one."""


class Shared(NamedTuple):
    """Relation of a parameter, and the standard deviation between parts, SI, where that is `AROUND`."""

    share: Share = Share.COMMON
    spread: float = 0.0


@dataclass(frozen=True)
class Sharing:
    """Map from points of the joint space to points of the parts' spaces.

    Attributes
    ----------
    names : tuple of str
        Of the joint parameters (D,).
    matrices : tuple of (d, D) array
        One for each part: its point is the joint one times the matrix, within its own bounds.
    bounds : tuple of (lower (d,), upper (d,))
        Of the parts' spaces, SI.
    """

    names: tuple[str, ...]
    matrices: tuple[Floats, ...]
    bounds: tuple[tuple[Floats, Floats], ...]

    def of_part(self, part: int, x: Floats) -> Floats:
        """Points (…, d) of a part from joint points (…, D), SI."""
        low, high = self.bounds[part]
        return np.clip(x @ self.matrices[part].T, low, high)


class _PartsConstraints(Products):
    """Constraints of all parts, at joint points.

    Parameters
    ----------
    spaces : sequence of Space
    sharing : Sharing
    """

    def __init__(self, spaces: Sequence[Space], sharing: Sharing) -> None:
        super().__init__()
        self._spaces, self._sharing = tuple(spaces), sharing

    def __len__(self) -> int:
        return sum(len(space.rows) + len(space.products) for space in self._spaces)

    @property
    def labels(self) -> tuple[str, ...]:
        """The texts that a person wrote."""
        return tuple(dict.fromkeys(label for space in self._spaces for label in space.labels))

    def shortfall(self, x: Floats) -> Floats:
        """Shortfall (…, m) of the constraints of each part."""
        parts = enumerate(self._spaces)
        return np.concatenate([space.shortfall(self._sharing.of_part(k, x)) for k, space in parts], axis=-1)


def joint_space(
    parts: Mapping[str, Space], shared: Mapping[str, Shared], rest: Share = Share.COMMON
) -> tuple[Space, Sharing]:
    """Space of the joint parameters, and the map from it to the parts.

    A common parameter has the bounds, start and prior that the first part with it states; one of a part has its part's
    own. A parameter that scatters is a common value and, for each part, its distance from it in standard deviations,
    whose prior is the standard normal distribution.

    Parameters
    ----------
    parts : mapping of str to Space
        Spaces of the parts by name.
    shared : mapping of str to Shared
        Relations by parameter.
    rest : Share
        Relation of the parameters that are not in `shared`.

    Raises
    ------
    ConfigurationError
        If `shared` names what no part has free.
    """
    known = dict.fromkeys(name for space in parts.values() for name in space.names)
    for name in shared:
        if name not in known:
            raise ConfigurationError(f"No part has the free parameter {name}{nearest(name, known)}.")
    found: dict[str, Parameter] = {}
    entries: list[list[tuple[int, str, float]]] = []
    for part, space in parts.items():
        own: list[tuple[int, str, float]] = []
        for row, parameter in enumerate(space.parameters):
            share, spread = shared.get(parameter.name, Shared(rest))
            if share is not Share.PER_PART:
                found.setdefault(parameter.name, parameter)
                own.append((row, parameter.name, 1.0))
            if share is not Share.COMMON:
                single = _of_part(parameter, part, share)
                found[single.name] = single
                own.append((row, single.name, spread if share is Share.AROUND else 1.0))
        entries.append(own)
    names = tuple(found)
    matrices = [_matrix(own, space.dimension, names) for own, space in zip(entries, parts.values(), strict=True)]
    bounds = tuple((space.lower, space.upper) for space in parts.values())
    sharing = Sharing(names, tuple(matrices), bounds)
    spaces = tuple(parts.values())
    return Space(tuple(found.values()), (), _PartsConstraints(spaces, sharing)), sharing


def _matrix(entries: Sequence[tuple[int, str, float]], rows: int, names: Sequence[str]) -> Floats:
    matrix = np.zeros((rows, len(names)))
    for row, name, factor in entries:
        matrix[row, names.index(name)] = factor
    return matrix


def _of_part(parameter: Parameter, part: str, share: Share) -> Parameter:
    """A part's own value, or its distance from the common one in standard deviations."""
    name = f"{parameter.name}{OF}{part}"
    if share is Share.PER_PART:
        return replace(parameter, name=name, signed=True)
    source = f"normally distributed about the common value of {parameter.name}"
    normal = Prior(0.0, 1.0, source)
    return Parameter(name, 0.0, -WIDEST, WIDEST, "1", mark="E", source=source, prior=normal, signed=True)
