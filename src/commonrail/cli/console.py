"""Output of the verbs: results on stdout, everything else on stderr."""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

import click

from commonrail.cli.grid import plain_pairs, plain_rows
from commonrail.notice import duration

if TYPE_CHECKING:
    from rich.console import Console

    from commonrail.display.table import Table

__all__ = [
    "COMPILING",
    "SIMULATING",
    "compiling",
    "compiling_words",
    "print_json",
    "print_pairs",
    "print_rows",
    "print_table",
    "say",
    "say_of_ending",
    "stderr_console",
]

SIMULATING = "simulating ..."
COMPILING = "compiling the simulation for this machine, once"
# Control characters but tab and line feed, and those that turn the direction of writing.
_OBEYED = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]")
WIDTH_OF_A_FILE = 160  # columns where stdout is no terminal


def say(text: str) -> None:
    """Print a line for the person, on stderr."""
    with suppress(OSError, ValueError, AttributeError):  # stderr is closed: continue the work
        click.echo(text, err=True)


def say_of_ending(text: str) -> None:
    """Write a line for the person from a handler of signals, which may meet a print in its middle."""
    with suppress(OSError):
        show_cursor = "\x1b[?25h" if os.isatty(2) else ""  # a bar hides it, and will not come to show it again
        os.write(2, f"{show_cursor}\ncommonrail: {text}\n".encode())


_under_way = False  # one display, also while one compilation needs another
_said = False  # the sentence, where it cannot be taken back


def compiling_words() -> str:
    """Sentence on a compilation and its duration."""
    return f"{COMPILING} ({duration()}) ..."


@contextmanager
def compiling() -> Iterator[None]:
    """Say that a simulation is being compiled, with a sign of life in a terminal, else once a process."""
    global _under_way, _said
    console = stderr_console()
    if _under_way or (_said and console is None):
        yield
        return
    _under_way = True
    try:
        if console is not None:
            with console.status(compiling_words()):
                yield
        else:
            _said = True
            say(compiling_words())
            yield
    finally:
        _under_way = False


def print_json(record: Mapping[str, Any]) -> None:
    """Print one JSON object on stdout; it must not contain NaN."""
    click.echo(json.dumps(record, indent=1, allow_nan=False))


def print_table(table: Table) -> None:
    """Print a table of the report."""
    rows = [[cell.plain for cell in row] for row in table.rows]
    print_rows(table.columns, rows, table.title, texts=table.texts)
    if table.note:
        click.echo(table.note)
    click.echo("")


def print_rows(
    columns: Sequence[str], rows: Sequence[Sequence[str]], title: str = "", texts: int | None = None
) -> None:
    """Print rows under their heads.

    Parameters
    ----------
    columns : sequence of str
        Heads.
    rows : sequence of sequences of str
        Cells.
    title : str
        Line above the heads, if any.
    texts : int or None
        Number of leading columns with text; those after them are numbers. None: all are text.
    """
    shown = [list(map(_shown, row)) for row in (columns, *rows)]
    texts = len(columns) if texts is None else texts
    plain = None if sys.stdout.isatty() else plain_rows(shown, title, texts, WIDTH_OF_A_FILE)
    if plain is not None:
        click.echo("\n".join(plain))
        return
    from rich import box
    from rich.table import Table as Grid

    grid = Grid(title=title or None, title_justify="left", box=box.SIMPLE_HEAD, title_style="bold")
    for index, column in enumerate(columns):
        grid.add_column(column, justify="right" if index >= texts else "left", overflow="fold")
    for row in shown[1:]:
        grid.add_row(*row)
    _print(grid)


def print_pairs(pairs: Sequence[tuple[str, str]], title: str) -> None:
    """Print names with their values."""
    shown = [list(map(_shown, pair)) for pair in pairs]
    click.echo(title)
    plain = None if sys.stdout.isatty() else plain_pairs(shown, WIDTH_OF_A_FILE)
    if plain is not None:
        click.echo("\n".join(plain))
        return
    from rich.table import Table as Grid

    grid = Grid.grid(padding=(0, 3))
    for pair in shown:
        grid.add_row(*pair)
    _print(grid)


def stderr_console() -> Console | None:
    """Console for progress; None where stderr is no terminal and is not taken for one."""
    wished = any(os.environ.get(name) for name in ("FORCE_COLOR", "TTY_COMPATIBLE"))
    console = _console(sys.stderr) if wished or sys.stderr.isatty() else None
    return console if console is not None and console.is_terminal else None


def _print(grid: Any) -> None:
    """Print on stdout without the spaces that fill rich's lines."""
    console = _console(sys.stdout)
    with console.capture() as captured:
        console.print(grid)
    click.echo("\n".join(line.rstrip() for line in captured.get().splitlines()))


def _shown(cell: str) -> str:
    """Text of a cell without what a terminal would obey: names come from files of others."""
    return _OBEYED.sub("?", cell)


def _console(stream: Any) -> Console:
    from rich.console import Console

    # No markup: "[mm3/ms]" is a unit here. A file or pipe must not be folded at 80 columns.
    width = None if stream.isatty() else WIDTH_OF_A_FILE
    return Console(file=stream, width=width, markup=False, highlight=False, emoji=False)
