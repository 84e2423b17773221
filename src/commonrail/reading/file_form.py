"""Form of a data file where its bytes do not tell it: encoding and decimal sign of a text, sheet of a workbook."""

from __future__ import annotations

import codecs
from typing import Annotated, Literal, NamedTuple

from pydantic import AfterValidator, Field

from commonrail.errors import InputError
from commonrail.reading.fields import FileModel, fault

__all__ = ["PLAIN", "FileForm", "FormModel", "check_encoding"]


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

# Encodings of Python for names of hosts and for literals: no file of measurements has them.
_NOT_OF_FILES = ("idna", "punycode", "raw-unicode-escape", "undefined", "unicode-escape", "unicode_escape")


def check_encoding(name: str, at: str) -> str:
    """Return the name of an encoding of texts.

    Raises
    ------
    InputError
        If there is none of that name; `at` is the place where it was stated.
    """
    if reason := _refusal(name):
        raise InputError(f"{at}: {reason}.")
    return name


def _refusal(name: str) -> str:
    """Reason why a name is none of an encoding of texts, empty if it is one."""
    try:
        found = codecs.lookup(name)
    except (LookupError, ValueError):  # a null character
        return f'there is no encoding "{name}"; write utf-8, utf-16 or cp1252'
    if not getattr(found, "_is_text_encoding", True) or found.name in _NOT_OF_FILES:
        return f'"{name}" is no encoding of texts; write utf-8, utf-16 or cp1252'
    return ""


def _encoding(name: str) -> str:
    if reason := _refusal(name):
        raise fault(reason)
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
