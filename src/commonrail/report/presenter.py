"""Content that a notebook shows of a kind of result: sentences, tables, figures, and named arrays in common units.

A result names its presenter, as ``module:object``, in the class attribute `presenter`; see `commonrail.base.display`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.base import registry
from commonrail.base.chart import Chart
from commonrail.base.table import Table
from commonrail.base.text import field_unit
from commonrail.base.units import convert


class Array(NamedTuple):
    """Named values over named axes.

    Attributes
    ----------
    axes : tuple of str
    values : array
        One dimension for each axis.
    unit : str
        Empty without a unit.
    """

    axes: tuple[str, ...]
    values: NDArray[Any]
    unit: str = ""


class Arrays(NamedTuple):
    """Axes by name, arrays over them by name, and the title."""

    axes: dict[str, Array]
    values: dict[str, Array]
    title: str


class Presenter(NamedTuple):
    """Content that a notebook shows of one kind of result, each made from the result.

    Attributes
    ----------
    lines : function
        Sentences; the first is the line that represents the result.
    tables, figures : function
    arrays : function, optional
        Values for pandas and xarray.
    """

    lines: Callable[[Any], Sequence[str]]
    tables: Callable[[Any], Sequence[Table]] = lambda _: ()
    figures: Callable[[Any], Sequence[Chart]] = lambda _: ()
    arrays: Callable[[Any], Arrays] | None = None

    @classmethod
    def of_record(
        cls,
        lines: Callable[[Any], Sequence[str]],
        tables: Callable[[Any], Sequence[Table]],
        figures: Callable[[Any], Sequence[Chart]],
    ) -> Presenter:
        """Presenter whose functions take the `record` of a result."""
        return cls(lambda r: lines(r.record()), lambda r: tables(r.record()), lambda r: figures(r.record()))


def presenter_of(result: Any) -> Presenter:
    """Presenter that a result names."""
    presenter: Presenter = registry.load(result.presenter)
    return presenter


def in_common_unit(axes: tuple[str, ...], values: Any, unit: str) -> Array:
    """Array in the unit of the field, such as MPa, from values in an SI unit."""
    name = "degC" if unit == "K" else field_unit(unit).name
    si_values = np.asarray(values)
    return Array(axes, si_values if name == unit else convert(si_values, unit, name), "" if unit == "1" else name)
