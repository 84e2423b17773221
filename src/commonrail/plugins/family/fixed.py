"""Values that the studies of a type's parts fixed, as values of the type."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from commonrail.base.hooks import note
from commonrail.base.units import to_text
from commonrail.calibration.injector_type import FixedValue
from commonrail.physics.injector import Source, parameter_quantities
from commonrail.readers.fields import UNSTATED

OF_PART = ("nozzle.hole_diameter", "nozzle.holes")  # the nozzle is a part's own


class PartValues(NamedTuple):
    """Values [SI] with which a part was fitted, the fitted ones being the best, and their sources.

    `stated` names the values that are not the injector file's.
    """

    name: str
    values: Mapping[str, float]
    sources: Mapping[str, Source]
    stated: Collection[str]


def fixed_values(parts: Sequence[PartValues], taken: Collection[str]) -> tuple[FixedValue, ...]:
    """Values of a type that are none of its parameters (`taken`), and that a part had in place of its injector's.

    Where the parts differ, the type takes the mean, and a note says so; nozzles that differ are the parts' own.
    """
    names = dict.fromkeys(name for part in parts for name in part.stated if name not in taken)
    found = []
    for name in names:
        having = [part for part in parts if name in part.values]
        values = [part.values[name] for part in having]
        if min(values) == max(values):
            mark, text = next(part for part in having if name in part.stated).sources.get(name, UNSTATED)
            found.append(FixedValue(name, values[0], mark, text))  # type: ignore[arg-type]
        elif name not in OF_PART:
            found.append(_mean(name, values, [part.name for part in having]))
    return tuple(found)


def _mean(name: str, values: Sequence[float], parts: Sequence[str]) -> FixedValue:
    unit = parameter_quantities()[name].unit
    mean = float(np.mean(values))
    own = ", ".join(f"{to_text(v, unit)} ({part})" for v, part in zip(values, parts, strict=True))
    note(
        f"{name} is not the same in all parts: {own}; the type takes the mean, {to_text(mean, unit)}. Where it was "
        'measured on the next part, give it the mark "M" in that injector\'s file.'
    )
    return FixedValue(name, mean, "F", f"mean of the parts: {own}")
