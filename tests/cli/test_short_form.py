"""Terminal output is the verdict and ten lines; --full prints all."""

from __future__ import annotations

from typing import Annotated

import pytest

from commonrail.base.table import table_from_columns
from commonrail.cli.console import print_json, print_pairs, print_rows, print_synthetic, print_text
from commonrail.cli.grammar import Option, table_verb, verb
from commonrail.cli.grid import LINES
from commonrail.cli.options import Json
from tests.cli.conftest import Command, invoke

HEADS = ("name", "value")


def rows(count: int, mark: str = "row") -> list[tuple[str, str]]:
    """Rows of a table."""
    return [(f"{mark} {index}", str(index)) for index in range(count)]


@table_verb
def shown(
    *,
    first: Annotated[int, Option()] = 30,
    second: Annotated[int, Option()] = 0,
    sentences: Annotated[int, Option()] = 1,
    pairs: Annotated[bool, Option("--pairs")] = False,
    json: Json = False,
) -> None:
    """Print tables.

    Example
    """
    if json:
        print_json({"rows": rows(first)})
    elif pairs:
        print_pairs(rows(first), "title")
    else:
        note = "A legend that explains the table. " * 20
        first_table = table_from_columns(
            "First", rows(first), [("name", lambda r: r[0]), ("value", lambda r: r[1])], note
        )
        print_synthetic("SYNTHETIC injector. Its values are estimates.")
        print_text([f"Sentence {index}." for index in range(sentences)], [first_table], ["A method."])
        if second:
            print_rows(HEADS, rows(second, "other"), "Second")


def lines_with(text: str, mark: str) -> list[str]:
    """Lines of a table's rows."""
    return [line for line in text.splitlines() if mark in line]


def counted(text: str) -> list[str]:
    """Lines below the verdict that count: no rule, no empty line, no hint."""
    lines = [line for line in text.splitlines() if line.strip("─ ") and not line.endswith(": --full")]
    return lines[lines.index("Sentence 0.") + 1 :]


@pytest.mark.parametrize("sentences", [1, 2, 5, 8, 20])
@pytest.mark.parametrize("second", [0, 1])
def test_a_command_prints_ten_lines_below_its_verdict(sentences: int, second: int) -> None:
    lines = counted(invoke(shown, "--sentences", sentences, "--second", second).out)
    assert len(lines) <= LINES == 10
    assert len(lines_with("\n".join(lines), "Sentence")) == min(sentences - 1, 4)  # six are left to the table


def test_what_is_left_out_is_counted() -> None:
    text = invoke(shown).out
    rows_shown = len(lines_with(text, "row "))
    assert rows_shown == 8  # below title and heads
    *_, hint = text.splitlines()
    assert hint == "2 more sentences, 22 more rows, 1 more note: --full"


def test_ten_pairs_are_printed_and_the_others_counted() -> None:
    text = invoke(shown, "--pairs").out
    assert len(lines_with(text, "row ")) == LINES
    assert text.splitlines()[-1] == "20 more rows: --full"


@pytest.mark.parametrize("form", [(), ("--pairs",)])
def test_full_prints_all(form: tuple[str, ...]) -> None:
    text = invoke(shown, "--full", "--second", "4", *form).out
    assert len(lines_with(text, "row ")) == 30
    assert len(lines_with(text, "other ")) == (0 if form else 4)
    assert "--full" not in text
    assert form or ("A method." in text and "estimates" in text)


@pytest.mark.parametrize(("first", "second", "others"), [(2, 3, 3), (2, 6, 0), (8, 1, 0)])
def test_a_later_table_is_printed_whole_or_named(first: int, second: int, others: int) -> None:
    text = invoke(shown, "--first", first, "--second", second).out
    assert len(lines_with(text, "row ")) == first
    assert len(lines_with(text, "other ")) == others
    assert ("1 more table (Second)" in text) == (others == 0)


def test_what_fits_has_no_hint() -> None:
    assert "--full" not in invoke(shown, "--first", 3, "--pairs").out


def test_json_is_complete() -> None:
    assert len(invoke(shown, "--json").record["rows"]) == 30


def test_a_verb_without_the_option_prints_all() -> None:
    @verb
    def plain(*, json: Json = False) -> None:
        """Print a table.

        Example
        """
        print_rows(HEADS, rows(30))

    assert len(lines_with(invoke(plain).out, "row ")) == 30


def test_the_catalogue_is_short_and_full(command: Command) -> None:
    short, full = (command("catalogue", "parameters", *form) for form in ((), ("--full",)))
    assert len(short.out.splitlines()) <= LINES + 8  # heads and hint
    assert len(full.out.splitlines()) > 100
    assert "nozzle.holes" in full.out
