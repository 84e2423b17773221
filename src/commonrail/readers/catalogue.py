"""TOML files by name: fuels, injectors and truths of the virtual test bench.

Some ship with the package. Those of an installed package are entry points of the groups "fuels", "injectors" and
"meters", whose object is the path of a file, or a function that returns it.
"""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import NamedTuple

from commonrail.base import registry
from commonrail.base.errors import InputError, nearest


class Catalogue(NamedTuple):
    """Folder of TOML files in a package."""

    package: str
    folder: str
    unknown: str  # beginning of the message for a name that is not there, such as ``There is no fuel "{}"``
    cure: str = ", or give the path of a .toml file"  # end of that message
    group: str = ""  # of the files of installed packages; empty if there are none

    def names(self) -> list[str]:
        """All names, those of installed packages behind those that ship."""
        own = self.shipped()
        return own + [name for name in registry.installed(self.group) if name not in own]

    def __contains__(self, name: object) -> bool:
        return name in self.shipped() or name in registry.installed(self.group)

    def shipped(self) -> list[str]:
        """Names of the files that ship without ``.toml``, sorted."""
        files = (entry.name for entry in (resources.files(self.package) / self.folder).iterdir())
        return sorted(name.removesuffix(".toml") for name in files if name.endswith(".toml"))

    def text(self, name: str, hint: str = "") -> str:
        """Text of a file; an unknown name raises `InputError` with `hint`, by default the nearest name."""
        if name in self.shipped():
            return (resources.files(self.package) / self.folder / f"{name}.toml").read_text(encoding="utf-8")
        if found := installed_text(self.group, name):
            return found
        known = self.names()
        raise InputError(
            f"{self.unknown.format(name)}{hint or nearest(name, known)}: choose one of {', '.join(known)}{self.cure}."
        )


def installed_text(group: str, name: str) -> str | None:
    """Text of a file of an installed package; None if there is none of that name.

    Raises `PluginError` if it cannot be read.
    """
    if (part := registry.find(group, name)) is None:
        return None
    found = part.load()
    with part.blamed("gives no file that can be read"):
        path = found() if callable(found) else found
        return str((Path(path) if isinstance(path, str) else path).read_text(encoding="utf-8"))
