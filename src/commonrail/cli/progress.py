"""Progress of long work on stderr: a bar in a terminal, lines in a file."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Any, NamedTuple

from commonrail.cli.console import compiling_words, say, stderr_console
from commonrail.notice import tell_of_compiling

__all__ = ["Bar", "Stage"]

STARTING = "starting"


class Stage(NamedTuple):
    """Progress of the work: phase, steps done, steps in all, and figures as text."""

    phase: str
    done: int
    total: int
    figures: str


class Bar(AbstractContextManager["Bar"]):
    """Progress of one piece of work.

    Parameters
    ----------
    title : str
        Said at the start.
    """

    def __init__(self, title: str) -> None:
        console = stderr_console()
        self.console = console if console is not None and console.is_terminal else None
        self.title = title
        self._said = (-1, "")

    def __enter__(self) -> Bar:
        say(self.title)
        if self.console is not None:
            self.bar = _rich_bar(self.console)
            self.bar.start()
            self.task = self.bar.add_task(STARTING, total=None, figures="")
        self._before = tell_of_compiling(self._compiling)
        return self

    @contextmanager
    def _compiling(self) -> Iterator[None]:
        if self.console is not None:
            self.bar.update(self.task, description=compiling_words(), refresh=True)
            yield
            self.bar.update(self.task, description=STARTING)
        else:
            say(compiling_words())
            yield

    def __exit__(self, *_: object) -> None:
        tell_of_compiling(self._before)
        if self.console is not None:
            self.bar.stop()

    def note(self, text: str) -> None:
        """Say a sentence without disturbing the bar."""
        if self.console is not None:
            self.console.print(text, highlight=False)
        else:
            say(text)

    def show(self, s: Stage) -> None:
        """Show a stage; in a file at its first step and at every tenth part of it."""
        if self.console is not None:
            self.bar.update(self.task, description=s.phase, completed=s.done, total=s.total, figures=s.figures)
            return
        part = (10 * s.done // max(s.total, 1), s.phase)
        if s.done > 0 and part != self._said:
            self._said = part
            say(f"{s.phase} {s.done}/{s.total}: {s.figures}")


def _rich_bar(console: Any) -> Any:
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
    from rich.progress import TimeRemainingColumn as Remaining

    return Progress(
        TextColumn("{task.description}"),
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        TextColumn("{task.fields[figures]}"),
        Remaining(),
        console=console,
    )
