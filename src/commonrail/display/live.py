"""Progress in a notebook: a bar that is drawn anew in its place, and a line while a kernel is compiled."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from html import escape
from typing import Any

from commonrail.notice import duration, tell_of_compiling

__all__ = ["Live", "in_notebook", "watch"]

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

        Parameters
        ----------
        text : str
        done, total : int
            Steps; without a total there is no bar.
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
        tell_of_compiling(_compiling)


@contextmanager
def _compiling() -> Iterator[None]:
    line = Live()
    line.show(f"{COMPILING} ({duration()}) …")
    yield
    line.show("")
