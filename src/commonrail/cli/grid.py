"""Tables as plain text in the width of a terminal: which columns fit, and where their cells break."""

from __future__ import annotations

import textwrap
import unicodedata
from collections.abc import Sequence
from itertools import accumulate, zip_longest
from typing import NamedTuple

LINES = 10  # below its verdict that a command prints without --full
FEWEST_ROWS = 5  # for which words are broken rather than columns left out
LINES_OF_HEADS = 3  # usual ones
GAP = 3  # spaces between two columns
NARROWEST = (22, 16)  # characters to which words of the first and of other columns are broken, unless one is longer
LONGEST_WORD = 36  # the longest name of a parameter has 35 characters; longer words, as of paths, are broken


def text_width(text: str) -> int:
    """Columns of a terminal that a text takes: none for accents and joiners, two for Chinese and Japanese signs."""
    if text.isascii():
        return len(text)
    return sum(
        0
        if unicodedata.category(sign) in ("Mn", "Me", "Cf")
        else 2
        if unicodedata.east_asian_width(sign) in "WF"
        else 1
        for sign in text
    )


class Grid(NamedTuple):
    """Columns of a table, each with its head first.

    `is_text`: whether a column has words, at the left, or numbers, at the right. `inputs`: heads of the columns that
    are left out first.
    """

    columns: tuple[tuple[str, ...], ...]
    is_text: tuple[bool, ...]
    inputs: tuple[str, ...] = ()

    def pick(self, indices: Sequence[int]) -> Grid:
        """Some of the columns."""
        return Grid(tuple(self.columns[i] for i in indices), tuple(self.is_text[i] for i in indices), self.inputs)

    def sizes(self, width: int, *, break_words: bool = False) -> list[int] | None:
        """Width of each column in a line of `width`; None if there is no room for its numbers and words."""
        sizes = [max(map(text_width, column), default=0) for column in self.columns]
        least = [1 if break_words else self._least(index) for index in range(len(sizes))]
        while sum(sizes) + GAP * (len(sizes) - 1) > width:
            shrinkable = [index for index in range(len(sizes)) if sizes[index] > least[index]]
            if not shrinkable:
                return None
            sizes[max(shrinkable, key=sizes.__getitem__)] -= 1
        return sizes

    def _least(self, index: int) -> int:
        """Smallest width of a column: cells of words may break between these, numbers only in their head."""
        head, *cells = self.columns[index]
        breakable = self.columns[index] if self.is_text[index] else (head,)
        widest_word = max((text_width(word) for cell in breakable for word in cell.split(" ")), default=0)
        if not self.is_text[index]:
            return max([widest_word, *map(text_width, cells)])
        return min(max(map(text_width, self.columns[index])), max(NARROWEST[index > 0], min(widest_word, LONGEST_WORD)))

    def lines(self, width: int) -> list[list[str]]:
        """Lines of each row, the heads first."""
        sizes = self.sizes(width) or self.sizes(width, break_words=True) or [1] * len(self.columns)
        return [
            ["".join(line).rstrip() for line in zip(*self._row_cells(row, sizes), strict=True)]
            for row in range(len(self.columns[0]))
        ]

    def _row_cells(self, row: int, sizes: Sequence[int]) -> list[list[str]]:
        """Lines of each cell of a row, equally many and filled with spaces."""
        broken = [break_cell(column[row], size) for column, size in zip(self.columns, sizes, strict=True)]
        cells = []
        for index, texts in enumerate(zip(*zip_longest(*broken, fillvalue=""), strict=True)):
            spaces = [" " * (sizes[index] - text_width(text)) for text in texts]
            gap = " " * GAP * (index + 1 < len(sizes))
            pairs = zip(texts, spaces, strict=True)
            cells.append([(text + space if self.is_text[index] else space + text) + gap for text, space in pairs])
        return cells

    def leave_out_columns(self, width: int, lines: int = LINES) -> Grid:
        """The table without what does not fit: inputs before a cell is broken, then last columns, never the first.

        More columns are left out where broken cells would leave room for few rows in so many lines.
        """
        indices = list(range(len(self.columns)))
        for index in reversed(range(1, len(self.columns))):
            if self.columns[index][0] in self.inputs and self.pick(indices).natural_width() > width:
                indices.remove(index)
        tables = [self.pick(indices[:count]) for count in range(len(indices), 0, -1)]
        fitting = [table for table in tables[:-1] if table.sizes(width) is not None] or tables[-1:]
        enough = min(len(self.columns[0]) - 1, FEWEST_ROWS, max(lines - LINES_OF_HEADS, 1))
        return next(
            (table for table in fitting if table.rows_within(width, lines) >= enough),
            max(fitting, key=lambda table: table.rows_within(width, lines)),
        )

    def rows_within(self, width: int, lines: int) -> int:
        """Number of the first rows that take at most so many lines, with their heads."""
        return max(sum(end <= lines for end in accumulate(map(len, self.lines(width)))) - 1, 0)

    def natural_width(self) -> int:
        """Width without broken cells."""
        return sum(max(map(text_width, column)) for column in self.columns) + GAP * (len(self.columns) - 1)

    def divide(self, width: int) -> list[Grid]:
        """Tables that fit, each with the first column and some of the others."""
        parts = [[0]]
        for index in range(1, len(self.columns)):
            if len(parts[-1]) > 1 and self.pick([*parts[-1], index]).sizes(width) is None:
                parts.append([0])
            parts[-1].append(index)
        return [self.pick(indices) for indices in parts]


def break_cell(text: str, size: int) -> list[str]:
    """Lines of a cell, broken between words; within a word only where it is longer than the line."""
    if text_width(text) <= size:
        return [text]
    characters = size if text_width(text) == len(text) else max(size // 2, 1)
    return textwrap.wrap(text, characters, break_on_hyphens=False) or [""]


PARAMETER_HEADS = ("parameter", "dimension")
DOTTED_NAME = "name"


def name_parameters(grid: Grid) -> Grid:
    """The table with parameters by their meaning, and their dotted names in a second column.

    A table that has the meaning in another column stays as it is, as does a name without a meaning of its own.
    """
    heads = [column[0] for column in grid.columns]
    if heads[0] not in PARAMETER_HEADS or "meaning" in heads:
        return grid
    from commonrail.report.parameter_names import describe_parameters

    head, *names = grid.columns[0]
    described = describe_parameters(names)
    texts = [described[name] for name in names]
    if texts == names:
        return grid
    dotted = (DOTTED_NAME, *("" if name == text else name for name, text in zip(names, texts, strict=True)))
    return Grid(((head, *texts), dotted, *grid.columns[1:]), (True, *grid.is_text), (*grid.inputs, DOTTED_NAME))
