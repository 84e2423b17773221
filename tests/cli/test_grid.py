"""Tables as text: they keep to the width, and break or leave out rather than cut."""

from __future__ import annotations

import random
import string

import pytest
from rich.cells import cell_len

from commonrail.cli.grid import Grid, name_parameters, text_width

WIDTH = 60
HEADS = ("test", "rail, MPa", "measured", "verdict")
ROWS = [("VL", "135", "57.40", "inside"), ("back flow", "80", "10.60", "outside")]


def grid_of(heads: tuple[str, ...], *rows: tuple[str, ...], texts: int = 1, inputs: tuple[str, ...] = ()) -> Grid:
    """Table whose first columns are words."""
    columns = tuple(zip(heads, *rows, strict=True))
    return Grid(columns, tuple(index < texts for index in range(len(heads))), inputs)


def words(rng: random.Random) -> str:
    """Some words, perhaps none."""
    return " ".join("".join(rng.choices(string.ascii_letters + "−µ漢", k=rng.randint(1, 14))) for _ in range(3))


@pytest.mark.parametrize("seed", range(20))
def test_no_line_is_too_wide_and_no_sign_is_lost(seed: int) -> None:
    rng = random.Random(seed)
    rows = [tuple(words(rng) for _ in range(3)) for _ in range(4)]
    grid = grid_of(("a", "b", "c"), *rows, texts=3)
    for part in grid.divide(WIDTH):
        lines = part.lines(WIDTH)
        assert max(cell_len(line) for row in lines for line in row) <= WIDTH
        for row, cells in zip(lines, zip(*part.columns, strict=True), strict=True):
            assert sorted("".join(row).replace(" ", "")) == sorted("".join(cells).replace(" ", ""))


def test_numbers_stand_below_one_another_at_the_right() -> None:
    lines = grid_of(HEADS, *ROWS).lines(WIDTH)
    assert [line.index("57.40" if "57" in line else "10.60") for (line,) in lines[1:]] == [27, 27]


def test_a_narrow_terminal_keeps_the_results_and_leaves_out_the_inputs() -> None:
    grid = grid_of(HEADS, *ROWS, inputs=("rail, MPa",))
    assert grid.leave_out_columns(WIDTH) == grid
    narrow = grid.leave_out_columns(32)
    assert [column[0] for column in narrow.columns] == ["test", "measured", "verdict"]


def test_without_inputs_the_last_columns_are_left_out_but_never_the_first() -> None:
    grid = grid_of(HEADS, *ROWS)
    assert [column[0] for column in grid.leave_out_columns(30).columns] == ["test", "rail, MPa", "measured"]
    assert [column[0] for column in grid.leave_out_columns(5).columns] == ["test"]


def test_parts_of_a_divided_table_say_whose_row_it_is() -> None:
    parts = grid_of(HEADS, *ROWS).divide(30)
    assert len(parts) == 2
    assert all(part.columns[0] == ("test", "VL", "back flow") for part in parts)


def test_parameters_are_printed_by_their_meaning_with_their_names_beside_it() -> None:
    rows = [("nozzle.holes", "8"), ("meter.bench.delay", "1"), ("valve.damping", "2"), ("armature.damping", "3")]
    grid = name_parameters(grid_of(("parameter", "value"), *rows))
    assert grid.columns[0][1:] == ("number of nozzle holes", "meter.bench.delay", "valve.damping", "armature.damping")
    assert grid.columns[1][1:] == ("nozzle.holes", "", "", "")  # where it says more than the first column
    assert name_parameters(grid_of(HEADS, *ROWS)).columns[0][0] == "test"


@pytest.mark.parametrize("text", ["漢字", "e\u0301", "±5 µm", "★\u00a0+0.2", "J/(kg·K)", "ａ"])
def test_the_width_of_a_text_is_that_of_a_terminal(text: str) -> None:
    assert text_width(text) == cell_len(text)
