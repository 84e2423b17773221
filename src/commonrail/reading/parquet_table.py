"""Parquet tables, judged by their description before a row is read: a small file may hold a huge table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from commonrail.errors import InputError
from commonrail.reading.csv_file import LONGEST_NAME, MOST_COLUMNS
from commonrail.reading.guarded_file import opened
from commonrail.reading.table_limits import MOST_ROWS, Groups, Indices

__all__ = ["ParquetTable", "read_parquet"]

LARGEST = 1_000_000_000  # [bytes] of the file
LARGEST_FOOTER = 2_000_000  # [bytes]; its objects take up to some hundred times as much
MOST_CELLS = 100_000_000
LARGEST_CONTENT = 2_000_000_000  # [bytes] uncompressed, and in memory
LONGEST_TEXT = 1000  # [bytes] of a cell
BATCH = 65_536  # rows that are decoded at a time

_MAGIC = b"PAR1"


@dataclass(frozen=True)
class ParquetTable:
    """Table of pyarrow: ten times smaller than its texts."""

    path: Path
    table: Any

    @property
    def header(self) -> list[str]:
        """Cells of the header."""
        return [str(name) for name in self.table.column_names]

    def groups(self, columns: Sequence[int]) -> Groups:
        """Rows by the texts in columns."""
        codes = np.zeros(self.table.num_rows, dtype=np.int64)
        texts = []
        for column in columns:
            encoded = self.table.column(column).combine_chunks().dictionary_encode()
            known = [*(_text(value) for value in encoded.dictionary.to_pylist()), ""]  # the last stands for no value
            codes = codes * len(known) + encoded.indices.fill_null(len(known) - 1).to_numpy(zero_copy_only=False)
            texts.append(known)
        order = np.argsort(codes, kind="stable")
        starts = np.flatnonzero(np.diff(codes[order], prepend=-1))
        parts = sorted(np.split(order, starts[1:]) if len(order) else [], key=lambda part: int(part[0]))
        found: dict[tuple[str, ...], list[Indices]] = {}
        for part in parts:
            found.setdefault(_decoded(int(codes[part[0]]), texts), []).append(part)
        return {key: np.sort(np.concatenate(same)) for key, same in found.items()}

    def cells(self, rows: Indices) -> list[list[str]]:
        """Texts of some rows."""
        taken = self.table.take(rows)
        columns = [[_text(value) for value in column.to_pylist()] for column in taken.columns]
        return [list(row) for row in zip(*columns, strict=True)]

    def place(self, row: int) -> str:
        """Location of a row."""
        return f"{self.path}, row {row + 1}"


def read_parquet(path: Path, content: BinaryIO | None = None) -> ParquetTable:
    """Read a table.

    Parameters
    ----------
    path : Path
    content : BinaryIO, optional
        Bytes of the file, where they have been read already.

    Raises
    ------
    InputError
        If pyarrow is not installed, the file cannot be read, or it is beyond a limit.
    """
    try:
        from pyarrow import parquet
    except ImportError:
        raise InputError(
            f'{path}: to read Parquet, pyarrow is needed; install it with pip install "commonrail[fleet]", or give CSV.'
        ) from None
    with nullcontext(content) if content is not None else opened(path, LARGEST) as stream, _told(path):
        _check_footer(path, stream)
        file = parquet.ParquetFile(stream)
        texts = _check_columns(path, file)
        _check_size(path, file.metadata)
        # Texts stay codes of the few that differ: a text repeated in every row takes no more than a number.
        file = parquet.ParquetFile(stream, read_dictionary=texts)
        return ParquetTable(path, _content(path, file))


@contextmanager
def _told(path: Path) -> Iterator[None]:
    from pyarrow import ArrowException

    try:
        yield
    except (ArrowException, OSError, ValueError) as error:
        reason = " ".join(str(error).split())[:200].rstrip(".")
        raise InputError(f"{path}: the file cannot be read as Parquet ({reason}).") from error


def _check_footer(path: Path, stream: BinaryIO) -> None:
    """Refuse a description that would itself fill the memory."""
    size = stream.seek(0, 2)
    stream.seek(max(size - 8, 0))
    end = stream.read(8)
    if len(end) < 8 or end[4:] != _MAGIC:
        raise ValueError("it does not end as Parquet does")
    if (length := int.from_bytes(end[:4], "little")) > LARGEST_FOOTER:
        raise _beyond(path, f"a description of {length / 1e6:.3g} MB", f"{LARGEST_FOOTER / 1e6:g} MB")
    stream.seek(0)


def _check_columns(path: Path, file: Any) -> list[str]:
    """Names of the columns of texts, once each column is found to hold one value in each row."""
    from pyarrow import types

    schema, described = file.schema_arrow, file.metadata.schema
    if len(schema) > MOST_COLUMNS or len(described) > MOST_COLUMNS:
        raise _beyond(path, f"{len(schema)} columns", f"{MOST_COLUMNS}")
    for name, kind in zip(schema.names, schema.types, strict=True):
        if types.is_nested(kind):
            raise InputError(
                f'{path}: the column "{name[:LONGEST_NAME]}" holds values of type {str(kind)[:40]}, and texts or '
                "numbers are expected; write one text or number in each row."
            )
        if len(name) > LONGEST_NAME:
            raise _beyond(path, "a name of a column with more characters", f"{LONGEST_NAME}")
    columns = [described.column(i) for i in range(len(described))]
    widest = max((column.length for column in columns if column.physical_type == "FIXED_LEN_BYTE_ARRAY"), default=0)
    if widest > LONGEST_TEXT:
        raise _beyond(path, f"cells of {widest} bytes", f"{LONGEST_TEXT}")
    return [column.path for column in columns if column.physical_type == "BYTE_ARRAY"]


def _check_size(path: Path, metadata: Any) -> None:
    """Refuse a table that would fill the memory, by what its description says of it."""
    rows, columns = metadata.num_rows, metadata.num_columns
    size = sum(metadata.row_group(i).total_byte_size for i in range(metadata.num_row_groups))
    if rows > MOST_ROWS:
        raise _beyond(path, f"{rows} rows", f"{MOST_ROWS}")
    if rows * columns > MOST_CELLS:
        raise _beyond(path, f"{rows} rows of {columns} columns", f"{MOST_CELLS} cells")
    if size > LARGEST_CONTENT:
        raise _too_full(path, size)


def _content(path: Path, file: Any) -> Any:
    """Table, read part by part, so that a description that is not true is found out."""
    import pyarrow
    from pyarrow import compute

    parts, size, rows = [], 0, 0
    for batch in file.iter_batches(batch_size=BATCH):
        size, rows = size + batch.nbytes, rows + batch.num_rows
        if size > LARGEST_CONTENT:
            raise _too_full(path, size)
        if rows > MOST_ROWS:
            raise _beyond(path, f"{rows} rows", f"{MOST_ROWS}")
        for name, column in zip(batch.schema.names, batch.columns, strict=True):
            if pyarrow.types.is_dictionary(column.type):
                longest = compute.max(compute.binary_length(column.dictionary)).as_py() or 0
                if longest > LONGEST_TEXT:
                    raise _beyond(path, f'a cell of {longest} bytes in the column "{name}"', f"{LONGEST_TEXT}")
        parts.append(batch)
    schema = parts[0].schema if parts else file.schema_arrow
    return pyarrow.Table.from_batches(parts, schema).unify_dictionaries()


def _too_full(path: Path, size: int) -> InputError:
    return _beyond(path, f"{size / 1e9:.3g} GB uncompressed", f"{LARGEST_CONTENT / 1e9:g} GB")


def _beyond(path: Path, found: str, limit: str) -> InputError:
    return InputError(f"{path}: the table has {found}, and at most {limit} are read; keep only what is needed.")


def _decoded(code: int, texts: Sequence[Sequence[str]]) -> tuple[str, ...]:
    found = []
    for known in reversed(texts):
        code, place = divmod(code, len(known))
        found.append(known[place])
    return tuple(reversed(found))


def _text(value: Any) -> str:
    if value is None:
        return ""
    return repr(value) if isinstance(value, float) else str(value).strip()
