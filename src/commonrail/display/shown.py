"""Results as notebooks show them: a short line, tables, figures, named arrays; `report` makes them on demand."""

from __future__ import annotations

import sys
from importlib import import_module
from typing import Any, ClassVar

__all__ = ["Shown", "lend"]

FACES = "commonrail.report.notebook"  # named, not imported: a result below knows no drawing

# Results of packages whose every source line is part of the stamp of compiled kernels: they are given methods and
# presenter when they are loaded, instead of deriving from `Shown`.
_LENT = {
    "commonrail.engine.solution": {
        "Solution": "commonrail.report.faces:SOLUTION",
        "Batch": "commonrail.report.faces:BATCH",
    },
    "commonrail.injector.definition": {"Injector": "commonrail.report.faces:INJECTOR"},
}
_METHODS = ("__repr__", "_repr_html_", "plot", "to_pandas", "to_xarray")


class Shown:
    """Result that can be shown, drawn, and handed on as a table or as named arrays.

    Attributes
    ----------
    presenter : str
        ``module:object`` of the `commonrail.report.presenter.Presenter` of its class, imported when it is needed.
    """

    presenter: ClassVar[str]

    def __repr__(self) -> str:
        """One line on the result."""
        return str(_faces().line_of(self))

    def _repr_html_(self) -> str:
        """Tables of the report, for a notebook."""
        return str(_faces().html_of(self))

    def plot(self) -> Any:
        """Figures of the report; a notebook shows them, `save` writes them as a page.

        Raises
        ------
        ConfigurationError
            If there is nothing to draw.
        """
        return _faces().plot_of(self)

    def to_pandas(self) -> Any:
        """Values as a pandas.DataFrame, with the unit behind each name; needs pandas.

        Raises
        ------
        ConfigurationError
            If pandas is missing, or the result has no table of values.
        """
        return _faces().frame_of(self)

    def to_xarray(self) -> Any:
        """Values as an xarray.Dataset with named axes and the attribute `units`; needs xarray.

        Raises
        ------
        ConfigurationError
            If xarray is missing, or the result has no arrays.
        """
        return _faces().dataset_of(self)


def _faces() -> Any:
    return import_module(FACES)


def lend() -> None:
    """Give the methods of `Shown` to the results of the physics rooms that are loaded."""
    for home, presenters in _LENT.items():
        module = sys.modules.get(home)
        for name, presenter in presenters.items():
            own: Any = getattr(module, name, None)
            if own is not None and not hasattr(own, "_repr_html_"):
                own.presenter = presenter
                for method in _METHODS:
                    setattr(own, method, vars(Shown)[method])
