"""Plain tables are those of rich, character by character."""

from __future__ import annotations

import io
import random
import string
import unicodedata

import pytest
from rich import box
from rich.cells import cell_len
from rich.console import Console
from rich.table import Table

from commonrail.cli.console import _NARROW, plain_pairs, plain_rows

WIDTH = 60


def drawn(grid: Table) -> list[str]:
    """Lines of rich's table without the spaces at their ends."""
    stream = io.StringIO()
    Console(file=stream, width=WIDTH, markup=False, highlight=False, emoji=False).print(grid)
    return [line.rstrip() for line in stream.getvalue().splitlines()]


def words(rng: random.Random, longest: int) -> str:
    """A word, perhaps an empty one, and perhaps two with a space between them."""
    return "".join(rng.choices(string.ascii_letters + "−µ·³ ", k=rng.randint(0, longest))).strip()


@pytest.mark.parametrize("seed", range(40))
def test_a_table_that_fits_is_that_of_rich(seed: int) -> None:
    rng = random.Random(seed)
    columns, texts = rng.randint(1, 5), rng.randint(0, 5)
    rows = [[words(rng, 14) for _ in range(columns)] for _ in range(rng.randint(1, 5))]
    title = words(rng, 30)
    grid = Table(title=title or None, title_justify="left", box=box.SIMPLE_HEAD)
    for index, head in enumerate(rows[0]):
        grid.add_column(head, justify="right" if index >= texts else "left", overflow="fold")
    for row in rows[1:]:
        grid.add_row(*row)
    plain = plain_rows(rows, title, texts, WIDTH)
    size = sum(max(map(len, column)) + 3 for column in zip(*rows, strict=True)) + 1
    assert (plain is None) == (size > WIDTH or len(title) > size)
    if plain is not None:
        assert plain == drawn(grid)


@pytest.mark.parametrize("seed", range(20))
def test_pairs_that_fit_are_those_of_rich(seed: int) -> None:
    rng = random.Random(seed)
    rows = [[words(rng, 20) or "name", words(rng, 45)] for _ in range(rng.randint(1, 5))]
    grid = Table.grid(padding=(0, 3))
    for row in rows:
        grid.add_row(*row)
    plain = plain_pairs(rows, WIDTH)
    if plain is not None:
        assert plain == drawn(grid)
    else:
        assert sum(max(map(len, column)) for column in zip(*rows, strict=True)) + 3 > WIDTH


def test_every_narrow_character_is_one_column_wide() -> None:
    narrow = [sign for sign in map(chr, range(0x3000)) if _NARROW.fullmatch(sign)]
    assert len(narrow) > 1500
    wrong = [hex(ord(sign)) for sign in narrow if cell_len(sign) != 1 and unicodedata.category(sign) != "Cn"]
    assert wrong == []


@pytest.mark.parametrize("cell", ["漢", "e\u0301", "a\nb", "a\tb", "😀"])
def test_a_cell_of_another_width_is_left_to_rich(cell: str) -> None:
    assert plain_rows([["head"], [cell]], "", 1, WIDTH) is None
    assert plain_pairs([["name", cell]], WIDTH) is None
