"""Reader of columns in JSON lines: the names with their units in a list, then the numbers of each row in one."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from commonrail.base.errors import InputError
from commonrail.base.input import LARGEST_FILE, read_plain
from commonrail.readers.columns import PLAIN, Column, FileForm, Table, find_column, name_and_unit


class JsonLines:
    """File of the ending .jsonl, a `commonrail.readers.columns.Sheet`."""

    independent_columns = True  # columns can be taken any number of times

    def __init__(self, path: Path, form: FileForm = PLAIN) -> None:
        self.path = path
        try:
            lines = [json.loads(line) for line in read_plain(path, LARGEST_FILE).decode().splitlines()]
            self._header = [name_and_unit(cell) for cell in lines[0]]
            self._rows = np.array(lines[1:], float).reshape(len(lines) - 1, len(self._header))
        except (IndexError, TypeError, ValueError, AttributeError, RecursionError) as error:
            raise InputError(f'{path}: expected lines like ["time [us]"] and [5.0] ({error}).') from error

    @property
    def names(self) -> list[str]:
        """Names of the columns."""
        return [name for name, _ in self._header]

    def unit(self, name: str) -> str:
        """Unit of a column, empty if its name has none."""
        return self._header[self.names.index(name)][1]

    def take(self, columns: Sequence[Column]) -> Table:
        """Content of columns in the units of the file."""
        values = {c.name: self._rows[:, find_column(self.path, self.names, c.name)] for c in columns}
        texts = {c.name: [f"{value:g}" for value in values.pop(c.name)] for c in columns if not c.unit}
        units = {c.name: self.unit(c.name) for c in columns}
        return Table(self.path, values, texts, units, np.arange(2, len(self._rows) + 2))
