"""Progress in a notebook."""

from __future__ import annotations

import sys
from types import SimpleNamespace
from typing import Any

import pytest

from commonrail.base import hooks
from commonrail.base.display import COMPILING, in_notebook, watch
from commonrail.calibration.search import Progress, live_progress


class Handle:
    """Output of a cell that keeps all it has shown."""

    def __init__(self) -> None:
        self.texts: list[tuple[str, str]] = []

    def update(self, shown: Any) -> None:
        """Keep the text and the HTML."""
        self.texts.append((repr(shown), shown._repr_html_()))


@pytest.fixture
def cell(monkeypatch: pytest.MonkeyPatch) -> Handle:
    """Kernel of a notebook, made up, and the output of its cell."""
    handle = Handle()
    shell = SimpleNamespace(kernel=object())
    made = SimpleNamespace(get_ipython=lambda: shell)
    monkeypatch.setitem(sys.modules, "IPython", made)
    monkeypatch.setitem(sys.modules, "IPython.display", SimpleNamespace(display=lambda *_, **__: handle))
    return handle


def test_outside_a_notebook_nothing_is_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: None))
    assert not in_notebook()
    assert live_progress() is None


def test_a_calibration_draws_a_bar(cell: Handle) -> None:
    show = live_progress()
    assert show is not None
    show(Progress("evolution <1>", 3, 30, 12.5, 20.0, 100, 2.0))
    text, html = cell.texts[-1]
    assert text == "evolution <1>: best 12.5, mean 20, 2 s"
    assert '<progress value="3" max="30"></progress> 3/30' in html
    assert "evolution &lt;1&gt;" in html


def test_compiling_is_said_and_taken_away_again(cell: Handle, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hooks, "_of_process", hooks.nullcontext)
    watch()
    with hooks.compiling():
        assert cell.texts[-1][0].startswith(COMPILING)
    assert cell.texts[-1][0] == ""
