"""Reader of Parquet tables for `guarded`: checked by their description before a row is read, then column by column.

A small file may hold a huge table, and its description may be false; the limits of the child process then apply.
"""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any

import pyarrow
from pyarrow import parquet, types

from commonrail.base.errors import InputError
from commonrail.readers.guarded import Save
from commonrail.readers.location import LONGEST_NAME, MOST_COLUMNS, MOST_ROWS

WHAT = "Parquet file"

LARGEST_FOOTER = 2_000_000  # [bytes]; its objects take up to a hundred times as much
MOST_CELLS = 100_000_000
LARGEST_CONTENT = 2_000_000_000  # [bytes] uncompressed
LONGEST_TEXT = 1000  # [bytes] of a cell

_MAGIC = b"PAR1"


def read(path: Path, data: bytes, save: Save) -> dict[str, Any]:
    """Header, number of rows, and the texts of each column.

    Array ``c<i>`` has the numbers of a column, or the indices of its texts; ``n<i>`` marks missing values.
    """
    try:
        _check_footer(path, data)
        file = parquet.ParquetFile(BytesIO(data))
        _check_columns(path, file)
        _check_size(path, file.metadata)
        columns = [file.metadata.schema.column(i) for i in range(file.metadata.num_columns)]
        # Texts remain codes of distinct texts: a repeated text takes no more memory than a number.
        coded = [column.path for column in columns if column.physical_type == "BYTE_ARRAY"]
        table = parquet.ParquetFile(BytesIO(data), read_dictionary=coded).read().unify_dictionaries()
        texts = [_save_column(path, name, i, table.column(i), save) for i, name in enumerate(table.column_names)]
    except (InputError, MemoryError):
        raise
    except (pyarrow.ArrowException, OSError, ValueError) as error:
        reason = " ".join(str(error).split())[:200].rstrip(".")
        raise InputError(f"{path}: the file cannot be read as Parquet ({reason}).") from error
    return {"header": [str(name) for name in table.column_names], "rows": table.num_rows, "texts": texts}


def _save_column(path: Path, header: str, i: int, column: Any, save: Save) -> list[str] | None:
    """Save a column; returns its texts, if it holds texts."""
    if column.null_count:
        save(f"n{i}", column.is_null().to_numpy())
    if types.is_integer(column.type) or types.is_floating(column.type):
        save(f"c{i}", column.fill_null(0).to_numpy())
        return None
    coded = column if types.is_dictionary(column.type) else column.dictionary_encode()
    coded = coded.combine_chunks()
    save(f"c{i}", coded.indices.fill_null(-1).to_numpy(zero_copy_only=False))
    texts = [str(text).strip() for text in coded.dictionary.to_pylist()]
    if (longest := max((len(text.encode()) for text in texts), default=0)) > LONGEST_TEXT:
        raise _beyond(path, f'a cell of {longest} bytes in the column "{header}"', f"{LONGEST_TEXT}")
    return texts


def _check_footer(path: Path, data: bytes) -> None:
    """Refuse a description that would itself fill the memory."""
    if len(data) < 8 or data[-4:] != _MAGIC:
        raise ValueError("it does not end as Parquet does")
    if (length := int.from_bytes(data[-8:-4], "little")) > LARGEST_FOOTER:
        raise _beyond(path, f"a description of {length / 1e6:.3g} MB", f"{LARGEST_FOOTER / 1e6:g} MB")


def _check_columns(path: Path, file: Any) -> None:
    """Refuse columns that do not hold one value in each row, or too many."""
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
            raise _beyond(path, "a column name with more characters", f"{LONGEST_NAME}")
    columns = [described.column(i) for i in range(len(described))]
    widest = max((column.length for column in columns if column.physical_type == "FIXED_LEN_BYTE_ARRAY"), default=0)
    if widest > LONGEST_TEXT:
        raise _beyond(path, f"cells of {widest} bytes", f"{LONGEST_TEXT}")


def _check_size(path: Path, metadata: Any) -> None:
    """Refuse a table that would fill the memory, by what its description says of it."""
    rows, columns = metadata.num_rows, metadata.num_columns
    size = sum(metadata.row_group(i).total_byte_size for i in range(metadata.num_row_groups))
    if rows > MOST_ROWS:
        raise _beyond(path, f"{rows} rows", f"{MOST_ROWS}")
    if rows * columns > MOST_CELLS:
        raise _beyond(path, f"{rows} rows of {columns} columns", f"{MOST_CELLS} cells")
    if size > LARGEST_CONTENT:
        raise _beyond(path, f"{size / 1e9:.3g} GB uncompressed", f"{LARGEST_CONTENT / 1e9:g} GB")


def _beyond(path: Path, size: str, limit: str) -> InputError:
    return InputError(f"{path}: the table has {size}, and at most {limit} are read; keep only what is needed.")
