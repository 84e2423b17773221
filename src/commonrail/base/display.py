"""Results as notebooks show them: a short line, tables, figures, named arrays; `report` makes them on demand."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from html import escape
from importlib import import_module
from typing import Any, ClassVar

from commonrail.base.errors import ConfigurationError
from commonrail.base.hooks import describe_compiling, set_compiling_listener

# Progress in a notebook: a bar updated in place, and a line while a kernel is compiled.

COMPILING = "compiling the simulation, once on this machine"


def in_notebook() -> bool:
    """True inside the kernel of a notebook; not in a terminal, in a test or in a worker."""
    interactive = sys.modules.get("IPython")
    shell = interactive.get_ipython() if interactive is not None else None
    return shell is not None and hasattr(shell, "kernel")


class Live:
    """Line of a notebook's output that is replaced as work goes on."""

    def __init__(self) -> None:
        from IPython.display import display

        self._shown: Any = display(_Text(""), display_id=True)

    def show(self, text: str, done: int = 0, total: int = 0) -> None:
        """Replace the line.

        `done` and `total`: steps; no total, no bar.
        """
        bar = f'<progress value="{done}" max="{total}"></progress> {done}/{total} ' if total else ""
        if self._shown is not None:
            self._shown.update(_Text(text, bar))


class _Text:
    """Line of output, with a bar where HTML is shown."""

    def __init__(self, text: str, bar: str = "") -> None:
        self.text, self.bar = text, bar

    def __repr__(self) -> str:
        return self.text

    def _repr_html_(self) -> str:
        return f"{self.bar}<small>{escape(self.text)}</small>"


def watch() -> None:
    """Say in a notebook when a kernel is compiled."""
    if in_notebook():
        set_compiling_listener(_compiling)


@contextmanager
def _compiling() -> Iterator[None]:
    line = Live()
    line.show(f"{COMPILING}{describe_compiling()} …")
    yield
    line.show("")


NOTEBOOK = "commonrail.report.notebook"  # a name, not an import: results do not depend on drawing


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
        return str(_notebook().line_of(self))

    def _repr_html_(self) -> str:
        """Tables of the report, for a notebook."""
        return str(_notebook().html_of(self))

    def plot(self, ax: Any = None, figure: int = 0, point: Any = None) -> Any:
        """Draw a figure of the result with matplotlib.

        Parameters
        ----------
        ax : matplotlib.axes.Axes or sequence of them, optional
            Axes for the panels of the figure, from the top; a single one takes the first panel. Default: a new figure.
        figure : int
            Number of the figure among those of `figures`, from 0.
        point : OperatingPoint, optional
            As for `figures`.

        Returns
        -------
        matplotlib.axes.Axes or array of them

        Raises
        ------
        ConfigurationError
            As `figures`; if matplotlib is missing, there is no such figure, or there are more axes than panels.
        """
        return _notebook().draw_of(self, ax, figure, point)

    def figures(self, point: Any = None) -> Any:
        """Figures of the report; a notebook shows them, `save` writes them as a page.

        `point`: an `OperatingPoint` that replaces the simulation's own; its energisings and delays are drawn. Raises
        `ConfigurationError` if there is nothing to draw, or a point is given for another result than a simulation.
        """
        return _notebook().picture_of(self, point)

    def to_pandas(self) -> Any:
        """Values as a pandas.DataFrame, with the unit after each name; needs pandas.

        Raises `ConfigurationError` if pandas is missing, or the result has no table of values.
        """
        return _notebook().frame_of(self)

    def to_xarray(self) -> Any:
        """Values as an xarray.Dataset with named axes and the attribute `units`; needs xarray.

        Raises `ConfigurationError` if xarray is missing, or the result has no arrays.
        """
        return _notebook().dataset_of(self)


def load_library(name: str, extra: str = "notebook") -> Any:
    """Import a library of an extra; ConfigurationError if it is missing."""
    try:
        return import_module(name)
    except ImportError as error:
        raise ConfigurationError(
            f"This needs {name}, which is not installed: install it with pip install 'commonrail[{extra}]'.",
            code="missing-package",
        ) from error


def _notebook() -> Any:
    return import_module(NOTEBOOK)
