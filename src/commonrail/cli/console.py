"""Output of the verbs: results on stdout, everything else on stderr."""

from __future__ import annotations

import json
import os
import re
import shutil
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any, NamedTuple, TextIO

import click

from commonrail.base.hooks import check_unheld_stop, describe_compiling, listen_to_compiling
from commonrail.base.stages import Listener
from commonrail.base.text import duration

if TYPE_CHECKING:
    from rich.console import Console

    from commonrail.base.table import Table

# Tables as plain text, where every cell fits into its line: rich, which folds the others, takes long to import.

# Characters of one column: Latin and Greek letters, signs of punctuation and mathematics.
_NARROW = re.compile(
    "[ -~\u00a0-\u00ac\u00ae-\u02ff\u0370-\u0377\u0384-\u03ff\u2010-\u2027\u2030-\u205e\u2070-\u20cf\u2100-\u22ff]*"
)


def plain_rows(rows: Sequence[Sequence[str]], title: str, texts: int, width: int) -> list[str] | None:
    """Lines of a table as rich draws it with `box.SIMPLE_HEAD`; None if a line has to be folded.

    The first of the rows are the heads; the first `texts` columns are text, those after them numbers, at the right.
    A line has `width` columns.
    """
    sizes = _sizes(rows)
    within = sum(size + 3 for size in sizes or []) - 1
    if sizes is None or within + 2 > width or len(title) > within + 2 or not _NARROW.fullmatch(title):
        return None
    aligned = [
        "   ".join(c.ljust(n) if i < texts else c.rjust(n) for i, (c, n) in enumerate(zip(row, sizes, strict=True)))
        for row in rows
    ]
    lines = ["", f"  {aligned[0]}", f" {'─' * within}", *(f"  {line}" for line in aligned[1:]), ""]
    return [line.rstrip() for line in ([title] if title else []) + lines]


def plain_pairs(rows: Sequence[Sequence[str]], width: int) -> list[str] | None:
    """Lines of names and values; None if one has to be folded."""
    sizes = _sizes(rows)
    if sizes is None or sum(sizes) + 3 > width:
        return None
    return [f"{name.ljust(sizes[0])}   {value}".rstrip() for name, value in rows]


def _sizes(rows: Sequence[Sequence[str]]) -> list[int] | None:
    """Width of each column; None if there is none, or a character whose width is not one column."""
    if not rows or not rows[0] or not all(_NARROW.fullmatch(cell) for row in rows for cell in row):
        return None
    return [max(map(len, column)) for column in zip(*rows, strict=True)]


SIMULATING = "simulating ..."
COMPILING = "compiling the simulation for this machine, once"
# Control characters but tab and line feed, and those that turn the direction of writing.
_OBEYED = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]")
WIDTH_OF_A_FILE = 160  # columns where stdout is no terminal
NARROW_TERMINAL = 100  # columns below which tables are divided rather than fold their words


def say(text: str) -> None:
    """Print a line for the person, on stderr."""
    with suppress(OSError, ValueError, AttributeError):  # stderr is closed: continue the work
        click.echo(_shown(text), err=True)


def say_of_ending(text: str) -> None:
    """Write a line for the person from a handler of signals, which may meet a print in its middle."""
    with suppress(OSError):
        show_cursor = "\x1b[?25h" if os.isatty(2) else ""  # a bar hides it, and will not come to show it again
        os.write(2, f"{show_cursor}\ncommonrail: {text}\n".encode())


_said = ""  # the last sentence, where it cannot be taken back


def compiling_words() -> str:
    """Sentence on a compilation: of what, and how long it takes."""
    return f"{COMPILING}{describe_compiling()} ..."


@contextmanager
def compiling() -> Iterator[None]:
    """Say that a simulation is being compiled, with a sign of life in a terminal, else once for each sentence."""
    global _said
    console, words = stderr_console(), compiling_words()
    if console is not None:
        with console.status(words):
            yield
        return
    if words != _said:
        _said = words
        say(words)
    yield


def print_json(record: Mapping[str, Any]) -> None:
    """Print one JSON object on stdout; it must not contain NaN."""
    click.echo(json.dumps(record, indent=1, allow_nan=False))


def print_result(
    json: bool, record: Callable[[], Mapping[str, Any]], show: Callable[[], None], files: Iterable[Path | None]
) -> None:
    """Print a result as JSON, or show it and say what was written; None stands for a file that was not asked for."""
    written = [str(path) for path in files if path is not None]
    if json:
        print_json({**record(), "files": written})
        return
    show()
    for path in written:
        say(f"wrote {path}")


def columns_of(stream: TextIO) -> int:
    """Columns of a terminal, or those that a file gets."""
    return shutil.get_terminal_size().columns if stream.isatty() else WIDTH_OF_A_FILE


def wrapped(text: str, indent: str = "") -> list[str]:
    """Lines of a sentence: in a terminal broken between words, those after the first behind `indent`, in a file one."""
    if not sys.stdout.isatty():
        return [text]
    width = columns_of(sys.stdout)
    return textwrap.wrap(text, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)


def print_lines(lines: Iterable[str]) -> None:
    """Print sentences, in a terminal broken between words."""
    for line in lines:
        click.echo("\n".join(wrapped(line)))


def print_text(lines: Iterable[str], tables: Sequence[Table] = ()) -> None:
    """Print sentences, and tables below them."""
    print_lines(lines)
    if tables:
        click.echo("")
    for table in tables:
        print_table(table)


def print_table(table: Table) -> None:
    """Print a table of the report."""
    rows = [[cell.plain for cell in row] for row in table.rows]
    print_rows(table.columns, rows, table.title, texts=table.texts)
    if table.note:
        print_lines([table.note])
    click.echo("")


def print_rows(
    columns: Sequence[str], rows: Sequence[Sequence[str]], title: str = "", texts: int | None = None
) -> None:
    """Print rows under their heads.

    `title`: line above the heads, if any. `texts`: number of leading columns with text; those after them are numbers.
    None: all are text. In a terminal of fewer than `NARROW_TERMINAL` columns a table that does not fit goes on below
    itself, with its first column again.
    """
    shown = [list(map(_shown, row)) for row in (columns, *rows)]
    texts = len(columns) if texts is None else texts
    plain = None if sys.stdout.isatty() else plain_rows(shown, title, texts, WIDTH_OF_A_FILE)
    if plain is not None:
        click.echo("\n".join(plain))
        return
    from rich import box
    from rich.table import Table as Grid

    for first, end in _parts(shown):
        kept = (0, *range(first, end))
        grid = Grid(title=title or None, title_justify="left", box=box.SIMPLE_HEAD, title_style="bold")
        for index in kept:
            grid.add_column(shown[0][index], justify="right" if index >= texts else "left", overflow="fold")
        for row in shown[1:]:
            grid.add_row(*(row[index] for index in kept))
        _print(grid)
        title = ""


def _parts(rows: Sequence[Sequence[str]]) -> list[tuple[int, int]]:
    """First column, and the one after the last, of each part that fits into a narrow terminal behind column 0."""
    from rich.cells import cell_len

    width, whole = columns_of(sys.stdout), len(rows[0])
    sizes = [max(map(cell_len, column)) + 3 for column in zip(*rows, strict=True)]
    starts = [1]
    for end in range(2, whole if width < NARROW_TERMINAL else 0):
        if sizes[0] + sum(sizes[starts[-1] : end + 1]) + 1 > width:
            starts.append(end)
    return list(zip(starts, [*starts[1:], whole], strict=True))


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
    for _ in range(2):
        grid.add_column(overflow="fold")
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


# Progress of long work on stderr: a bar in a terminal, lines in a file.

STARTING = "starting"


class Stage(NamedTuple):
    """Progress of the work: phase, steps done, steps in all, and figures as text."""

    phase: str
    done: int
    total: int
    figures: str


class Bar(AbstractContextManager["Bar"]):
    """Progress of one piece of work.

    `title`: said at the start.
    """

    def __init__(self, title: str) -> None:
        console = stderr_console()
        self.console = console if console is not None and console.is_terminal else None
        self.title = title
        self._said = (-1, "")
        self._first = 0, 0.0  # step that was first shown of this phase, and when [s]

    def __enter__(self) -> Bar:
        say(self.title)
        if self.console is not None:
            self.bar = _rich_bar(self.console)
            self.bar.start()
            self.task = self.bar.add_task(STARTING, total=None, figures="")
        self._telling = listen_to_compiling(self._compiling)
        self._telling.__enter__()
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
        self._telling.__exit__(None, None, None)
        if self.console is not None:
            self.bar.stop()

    def note(self, text: str) -> None:
        """Say a sentence without disturbing the bar."""
        if self.console is not None:
            self.console.print(text, highlight=False)
        else:
            say(text)

    def show(self, s: Stage) -> None:
        """Show a stage; in a file at its first step and at every tenth part of it, with the time that is left."""
        check_unheld_stop()
        if self.console is not None:
            self.bar.update(self.task, description=s.phase, completed=s.done, total=s.total, figures=s.figures)
            return
        part = (10 * s.done // max(s.total, 1), s.phase)
        if s.done > 0 and part != self._said:
            if s.phase != self._said[1]:
                self._first = s.done, monotonic()
            steps, seconds = s.done - self._first[0], monotonic() - self._first[1]
            left = f", {duration(seconds / steps * (s.total - s.done))} left" if steps > 0 and s.done < s.total else ""
            self._said = part
            say(f"{s.phase} {s.done}/{s.total}: {s.figures}{left}")


def shown_by(bar: Bar, after: float = 0.0) -> Listener:
    """Listener that numbers the stages of each phase and shows them, in a file those that end `after` so long [s]."""
    counts: dict[str, int] = {}
    start: list[float] = []

    def show(phase: str, done: int, most: int, figures: str) -> None:
        start[:] = start or [monotonic()]
        counts[phase] = counts.get(phase, 0) + (done == 0)
        if bar.console is not None or monotonic() >= start[0] + after:
            bar.show(Stage(f"{phase} {counts[phase]}", done, most, figures))

    return show


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
