"""Places in files, for messages: every error says file and key or line."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from commonrail.base.errors import CommonrailError, InputError, nearest_key

_KINDS = {
    "commonrail-injector": "an injector file",
    "commonrail-study": "a study file",
    "commonrail-fmu-study": "a study of an FMU",
    "commonrail-fleet": "a fleet file",
    "commonrail-truth": "a truth of the virtual test bench",
    "commonrail-type": "a type of injector",
    "commonrail-family": "a family of injectors",
    "commonrail-tolerance": "a tolerance study",
}


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

    def check_format(self, document: Mapping[str, Any], wanted: str) -> None:
        """Refuse a document whose key ``format`` is not `wanted`, and say so if it is a file of another kind."""
        found, kind = document.get("format"), _KINDS[wanted.partition("/")[0]]
        if found == wanted:
            return
        other = _KINDS.get(found.partition("/")[0], kind) if isinstance(found, str) else kind
        if other != kind:
            raise self.error(f'this is {other} (format = "{found}"), and {kind} is expected; name that file instead')
        what = "format is missing" if found is None else f"format is {found!r}"
        raise self.error(f'{what}; {kind} begins with format = "{wanted}"')

    def refuse_unknown(self, table: Mapping[str, Any], known: Collection[str]) -> None:
        """Refuse the first key of a table that is not `known`, with the nearest that is."""
        for key in table:
            if key not in known:
                raise self.error(f'there is no key "{key}"{nearest_key(key, known)}')


@contextmanager
def located(place: Place) -> Iterator[None]:
    """Put the place before the message of any error of the project raised inside."""
    try:
        yield
    except CommonrailError as error:
        placed = type(error)(f"{place}: {str(error).removesuffix('.')}.")
        for line in getattr(error, "__notes__", ()):
            placed.add_note(line)
        raise placed from error
