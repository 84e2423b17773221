"""Output of the verbs: results on stdout, everything else on stderr."""

from __future__ import annotations

import json
import os
import re
import shutil
import sys
import textwrap
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass, field
from itertools import accumulate, chain
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any, NamedTuple, TextIO

import click

from commonrail.base.hooks import check_unheld_stop, describe_compiling, listen_to_compiling
from commonrail.base.stages import Listener
from commonrail.base.text import count_noun, duration
from commonrail.cli.grid import LINES, Grid, name_parameters, text_width

if TYPE_CHECKING:
    from rich.console import Console

    from commonrail.base.table import Table

SIMULATING = "simulating ..."
COMPILING = "compiling the simulation for this machine, once"
# Control characters but tab and line feed, and those that turn the direction of writing.
_OBEYED = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]")
ROOM_OF_TABLES = 6  # lines of a short form
WIDTH_OF_A_FILE = 100  # columns where stdout is not a terminal


def say(text: str) -> None:
    """Print a line for the person, on stderr."""
    with suppress(OSError, ValueError, AttributeError):  # stderr is closed: continue the work
        click.echo(_mask_controls(text), err=True)


def say_of_ending(text: str) -> None:
    """Write a line from a signal handler, which may interrupt a print."""
    with suppress(OSError):
        show_cursor = "\x1b[?25h" if os.isatty(2) else ""  # a bar hides the cursor and cannot restore it
        os.write(2, f"{show_cursor}\ncommonrail: {text}\n".encode())


_said_once: set[str] = set()


def say_once(text: str) -> None:
    """Print a line for the person, on stderr, unless it has been printed before."""
    if text not in _said_once:
        _said_once.add(text)
        say(text)


def compiling_words() -> str:
    """Sentence on a compilation: of what, and how long it takes."""
    return f"{COMPILING}{describe_compiling()} ..."


@contextmanager
def compiling() -> Iterator[None]:
    """Report that a simulation is being compiled: a spinner in a terminal, else each sentence once."""
    console, words = stderr_console(), compiling_words()
    if console is not None:
        with console.status(words):
            yield
        return
    say_once(words)
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


def wrap_line(text: str, indent: str = "") -> list[str]:
    """Lines of a sentence: wrapped in a terminal, with `indent` from the second line on; a single line in a file."""
    if not sys.stdout.isatty():
        return [text]
    width = columns_of(sys.stdout)
    return textwrap.wrap(text, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)


def print_lines(lines: Iterable[str]) -> None:
    """Print sentences, in a terminal broken between words."""
    for line in lines:
        click.echo("\n".join(wrap_line(line)))


def print_text(
    lines: Iterable[str], tables: Sequence[Table] = (), notes: Iterable[str] = (), *, reserved: int = ROOM_OF_TABLES
) -> None:
    """Print a verdict, further sentences and tables; in a short form those that fit.

    Parameters
    ----------
    lines : iterable of str
        Sentences, the most important first. A short form always prints the first sentence of a command, the verdict.
    tables : sequence of Table
        Tables below the sentences.
    notes : iterable of str
        Explanations, which a short form leaves out.
    reserved : int
        Lines of a short form that are reserved for the tables.
    """
    short, sentences = short_form(), [*lines]
    if short is None:
        sentences += notes
    else:
        verdict = sentences[: not short.has_begun]
        sentences = verdict + short.take_sentences(sentences[len(verdict) :], reserved if tables else 0)
        short.is_below_text = bool(sentences)
        short.has_begun |= bool(sentences)
        short.omit("sentence", len([*notes]))
    print_lines(sentences)
    if tables and short is None:
        click.echo("")
    for table in tables:
        print_table(table)


def print_synthetic(text: str) -> None:
    """Report that data or assumptions are synthetic, and why; a short form prints the first sentence."""
    if not text:
        return
    short, begin = short_form(), "" if text.startswith("SYNTHETIC") else "SYNTHETIC: "
    first, *others = re.split(r"(?<=\.) ", text)
    if short and others:
        short.omit("sentence", len(others))
        text = first
    print_lines([f"{begin}{text}"])


SHORT = "commonrail.short_form"  # key in the context of click
ROWS_BELOW_TEXT = 2  # least rows of a table; without room for them the table is omitted
NAMED_TABLES = 3


@dataclass
class ShortForm:
    """Short form of one command: lines left below its verdict, and counts of omitted items.

    Rules and empty lines do not count.
    """

    lines: int = LINES
    omitted: Counter[str] = field(default_factory=Counter)
    tables: list[str] = field(default_factory=list)
    has_begun: bool = False  # a verdict or a table is printed
    has_table: bool = False
    is_below_text: bool = False  # the last print was a sentence

    def omit(self, noun: str, count: int) -> None:
        """Count what is left out."""
        self.omitted[noun] += count

    def take_sentences(self, sentences: Sequence[str], reserved: int) -> list[str]:
        """The first sentences that fit above so many lines."""
        self.lines -= reserved
        shown = self.take("sentence", [[sentence] for sentence in sentences], [len(wrap_line(s)) for s in sentences])
        self.lines += reserved
        return [sentence for (sentence,) in shown]

    def take_rows(self, title: str, heads: int, sizes: Sequence[int]) -> int:
        """Number of rows that a table prints; `sizes`: lines of each row, `heads`: lines above the rows.

        The first table prints at least one row if nothing precedes it, else `ROWS_BELOW_TEXT` or none. A later table
        prints all rows or none.
        """
        count = sum(end <= self.lines - heads for end in accumulate(sizes))
        if not self.has_begun:
            count = max(count, min(len(sizes), 1))
        elif count < (len(sizes) if self.has_table else min(len(sizes), ROWS_BELOW_TEXT)):
            self.tables.append(title)
            return 0
        self.has_begun = self.has_table = True
        self.lines -= heads + sum(sizes[:count])
        self.omit("row", len(sizes) - count)
        return count

    def take(self, noun: str, items: list[list[str]], sizes: Sequence[int] = (), least: int = 0) -> list[list[str]]:
        """The first items, of `sizes` lines each, that fit, and at least `least`."""
        sizes = sizes or [*map(len, items)]
        count = max(sum(end <= self.lines for end in accumulate(sizes)), min(least, len(items)))
        self.lines -= sum(sizes[:count])
        self.omit(noun, len(items) - count)
        return items[:count]

    def take_note(self, lines: list[str]) -> list[str]:
        """Lines of the note below a table, if there is room for them."""
        return lines if self.take("note", [lines] * bool(lines)) else []

    def hint(self) -> str:
        """Sentence on what is left out; empty if nothing is."""
        parts = [f"{count:,} more {noun}{'s' * (count > 1)}" for noun, count in self.omitted.items() if count]
        if self.tables:
            names = list(dict.fromkeys(re.split("[,:(]", title)[0].strip() for title in self.tables))
            rest = ["..."] * (len(names) > NAMED_TABLES)
            parts.append(f"{count_noun(len(self.tables), 'more table')} ({', '.join([*names[:NAMED_TABLES], *rest])})")
        return f"{', '.join(parts)}: --full" if parts else ""


def short_form() -> ShortForm | None:
    """Short form of the command that runs; None if it prints in full."""
    context = click.get_current_context(silent=True)
    return None if context is None else context.meta.get(SHORT)


def begin_result() -> None:
    """Give the next of several results of a command a short form of its own."""
    if short := short_form():
        short.lines, short.has_begun, short.has_table = LINES, False, False


def print_table(table: Table) -> None:
    """Print a table of the report."""
    rows = [[cell.plain for cell in row] for row in table.rows]
    print_rows(table.columns, rows, table.title, table.texts, table.inputs, table.note)


def print_rows(
    columns: Sequence[str],
    rows: Sequence[Sequence[str]],
    title: str = "",
    texts: int | None = None,
    inputs: Sequence[str] = (),
    note: str = "",
) -> None:
    """Print rows under their heads: in a short form those that fit, else all, in parts that fit.

    Parameters
    ----------
    columns, rows : sequence
        Heads, and the cells below them.
    title, note : str
        Sentences above the heads and below the rows.
    texts : int, optional
        Number of leading columns with words; the others have numbers. By default all have words.
    inputs : sequence of str
        Heads of the columns that a short form omits first: inputs, not results.
    """
    short, width = short_form(), columns_of(sys.stdout) - 2
    cells = [_cells(row) for row in (columns, *rows)]
    is_text = tuple(index < (len(columns) if texts is None else texts) for index in range(len(columns)))
    grid = name_parameters(Grid(tuple(zip(*cells, strict=True)), is_text, tuple(inputs)))
    titles, notes, count = wrap_line(title) if title else [], wrap_line(note) if note else [], len(rows)
    parts = [grid.leave_out_columns(width, short.lines - len(titles))] if short else grid.divide(width)
    if short:
        first, *sizes = map(len, parts[0].lines(width))
        count = short.take_rows(title, len(titles) + first, sizes)
        if rows and not count:
            return
        if short.is_below_text:
            click.echo("")
            short.is_below_text = False
        short.omit("column", len(grid.columns) - len(parts[0].columns))
        notes = short.take_note(notes)
    if titles:
        click.echo("\n".join(click.style(line, bold=True) for line in titles))
    for section in parts:
        heads, *lines = section.lines(width)
        rule = "─" * (max(map(text_width, chain(heads, *lines))) + 1)
        body = [f"  {line}" for line in (*heads, *chain.from_iterable(lines[:count]))]
        click.echo("\n".join([*body[: len(heads)], f" {rule}", *body[len(heads) :]]))
    click.echo("\n".join(["", *notes, ""] if notes else [""]))


def print_pairs(pairs: Sequence[tuple[str, str]], title: str) -> None:
    """Print names with their values: in a short form those that fit."""
    columns = tuple(zip(*map(_cells, pairs), strict=True)) or ((), ())
    lines = Grid(columns, (True, True)).lines(columns_of(sys.stdout))
    short = short_form()
    count = short.take_rows(title, 0, list(map(len, lines))) if short else len(lines)
    click.echo("\n".join([title, *chain.from_iterable(lines[:count])]))


def stderr_console() -> Console | None:
    """Console for progress; None where stderr is no terminal and is not taken for one."""
    wished = any(os.environ.get(name) for name in ("FORCE_COLOR", "TTY_COMPATIBLE"))
    console = _console(sys.stderr) if wished or sys.stderr.isatty() else None
    return console if console is not None and console.is_terminal else None


def _mask_controls(text: str) -> str:
    """Text without control characters, which files of others may contain."""
    return _OBEYED.sub("?", text)


def _cells(row: Sequence[str]) -> list[str]:
    """Texts of a row, each on one line."""
    return [re.sub(r"[\t\n]+", " ", _mask_controls(cell)) for cell in row]


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
        """Show a stage; in a file, write a line at the first step and at each tenth, with the remaining time."""
        check_unheld_stop()
        if self.console is not None:
            self.bar.update(self.task, description=s.phase, completed=s.done, total=s.total, figures=s.figures)
            return
        tenth_and_phase = (10 * s.done // max(s.total, 1), s.phase)
        if s.done > 0 and tenth_and_phase != self._said:
            if s.phase != self._said[1] or tenth_and_phase[0] < self._said[0]:  # another phase, or the same again
                self._first = s.done, monotonic()
            steps, seconds = s.done - self._first[0], monotonic() - self._first[1]
            left = f", {duration(seconds / steps * (s.total - s.done))} left" if steps > 0 and s.done < s.total else ""
            self._said = tenth_and_phase
            say(f"{s.phase} {s.done}/{s.total}: {s.figures}{left}")


def show_stages_on(bar: Bar, after: float = 0.0) -> Listener:
    """Listener that shows the stages of each phase; in a file, only stages later than `after` [s]."""
    start: list[float] = []

    def show(phase: str, done: int, most: int, figures: str) -> None:
        start[:] = start or [monotonic()]
        if bar.console is not None or monotonic() >= start[0] + after:
            bar.show(Stage(phase, done, most, figures))

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
