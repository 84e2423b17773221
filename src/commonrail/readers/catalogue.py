"""Files that ship with the package, by name: fuels, injectors and truths of the virtual test bench."""

from __future__ import annotations

from importlib import resources
from typing import NamedTuple

from commonrail.base.errors import InputError, nearest


class Catalogue(NamedTuple):
    """Folder of TOML files in the package.

    Attributes
    ----------
    room, folder : str
        Package that has the folder, and the folder's name.
    unknown : str
        Beginning of the message for a name that is not there, such as ``There is no fuel "{}"``.
    cure : str
        End of that message.
    """

    room: str
    folder: str
    unknown: str
    cure: str = ", or give the path of a .toml file"

    def names(self) -> list[str]:
        """Names of the files without ``.toml``, sorted."""
        files = (entry.name for entry in (resources.files(self.room) / self.folder).iterdir())
        return sorted(name.removesuffix(".toml") for name in files if name.endswith(".toml"))

    def text(self, name: str, hint: str = "") -> str:
        """Text of a file; an unknown name raises `InputError` with `hint`, by default the nearest name."""
        known = self.names()
        if name not in known:
            raise InputError(
                f"{self.unknown.format(name)}{hint or nearest(name, known)}: choose one of "
                f"{', '.join(known)}{self.cure}."
            )
        return (resources.files(self.room) / self.folder / f"{name}.toml").read_text(encoding="utf-8")
