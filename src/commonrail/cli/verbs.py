"""Verbs of the command, each imported when it is called."""

from __future__ import annotations

from collections.abc import Iterator, MutableMapping
from typing import Any

import typer
from typer.core import TyperGroup
from typer.main import get_command

from commonrail.cli.guard import guarded
from commonrail.cli.names import VERBS, function_of
from commonrail.cli.typer_later import with_typer

__all__ = ["PLAIN", "Verbs"]

# Plain help and errors: they read the same in a terminal, a log and a page of documentation.
PLAIN: Any = {
    "add_completion": False,
    "rich_markup_mode": None,
    "pretty_exceptions_enable": False,
    "context_settings": {"help_option_names": ["-h", "--help"], "max_content_width": 100},
}


class Verbs(TyperGroup):
    """Group of the verbs, which knows their names and imports the module of the one that is asked for."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands = _Commands()

    def list_commands(self, ctx: Any) -> list[str]:
        """Names of the verbs, in the order of the help."""
        return list(VERBS)


class _Commands(MutableMapping[str, Any]):
    """Commands by name, made when they are looked up."""

    def __init__(self) -> None:
        self._made: dict[str, Any] = {}

    def __getitem__(self, name: str) -> Any:
        if name not in self._made:
            if name not in VERBS:
                raise KeyError(name)
            self._made[name] = _command(name)
        return self._made[name]

    def __setitem__(self, name: str, command: Any) -> None:
        self._made[name] = command

    def __delitem__(self, name: str) -> None:
        raise TypeError("The verbs are fixed.")

    def __iter__(self) -> Iterator[str]:
        return iter(VERBS)

    def __len__(self) -> int:
        return len(VERBS)


def _command(name: str) -> Any:
    """Command of a verb."""
    alone = typer.Typer(**PLAIN)
    alone.command(name)(with_typer(guarded(function_of(name))))
    return get_command(alone)
