"""Where in a file something stands, for messages: every error says file and key or line."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from commonrail.errors import CommonrailError, InputError, nearest

__all__ = ["Place", "located"]


@dataclass(frozen=True)
class Place:
    """A key in a file; ``place / "key"`` goes into a table, ``place[0]`` into a list.

    Lists count from 1 in the text, as people do.
    """

    file: str
    key: str = ""

    def __str__(self) -> str:
        return f"{self.file}, {self.key}" if self.key else self.file

    def __truediv__(self, key: str) -> Place:
        return Place(self.file, f"{self.key}.{key}" if self.key else key)

    def __getitem__(self, index: int) -> Place:
        return Place(self.file, f"{self.key}[{index + 1}]")

    def error(self, sentence: str) -> InputError:
        """Error that opens with this place."""
        return InputError(f"{self}: {sentence}.")

    def refuse_unknown(self, table: Mapping[str, Any], known: Collection[str]) -> None:
        """Refuse the first key of a table that is not `known`, with the nearest that is."""
        for key in table:
            if key not in known:
                raise self.error(f'there is no key "{key}"{nearest(key, known)}')


@contextmanager
def located(place: Place) -> Iterator[None]:
    """Put the place before the message of any error of the project raised inside."""
    try:
        yield
    except CommonrailError as error:
        raise type(error)(f"{place}: {str(error).removesuffix('.')}.") from error
