"""Form of a data file where its bytes do not tell it: encoding and decimal sign of a text, sheet of a workbook."""

from __future__ import annotations

import codecs
from typing import Annotated, Literal, NamedTuple

from pydantic import AfterValidator, Field

from commonrail.reading.fields import FileModel, fault

__all__ = ["PLAIN", "FileForm", "FormModel"]


class FileForm(NamedTuple):
    """Form of a file, as stated by whoever reads it.

    Attributes
    ----------
    encoding : str
        Of a text; empty for UTF-8.
    decimal : str
        Decimal sign of the numbers of a text, "." or ",".
    sheet : str
        Of a workbook; empty for the first that is not empty.
    """

    encoding: str = ""
    decimal: str = "."
    sheet: str = ""


PLAIN = FileForm()


def _encoding(name: str) -> str:
    try:
        found = codecs.lookup(name)
    except LookupError as error:
        raise fault(f'there is no encoding "{name}"; write utf-8, utf-16 or cp1252') from error
    if not getattr(found, "_is_text_encoding", True):
        raise fault(f'"{name}" is no encoding of texts; write utf-8, utf-16 or cp1252')
    return name


class FormModel(FileModel):
    """Keys that state the form of the table's file."""

    encoding: Annotated[str, Field(max_length=40), AfterValidator(_encoding)] | None = None
    decimal: Literal[".", ","] = "."
    sheet: str | None = None

    @property
    def form(self) -> FileForm:
        """The form that the keys state."""
        return FileForm(self.encoding or "", self.decimal, self.sheet or "")
