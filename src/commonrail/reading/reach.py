"""Folder that the names in a file must not lead out of: a study from anywhere must not read what is not its own."""

from __future__ import annotations

import os
from pathlib import Path
from typing import NamedTuple

from commonrail.reading.guarded_file import similar_names
from commonrail.reading.place import Place

__all__ = ["ALLOW", "Reach"]

ALLOW = "allow_outside"


class Reach(NamedTuple):
    """Folder that no name may lead out of, unless the file that sets it says so.

    Attributes
    ----------
    file : Path
        File that the user named; what it names lies in its folder or below.
    outside : bool
        Whether that file allows other places.
    """

    file: Path
    outside: bool

    def path(self, folder: Path, name: str, at: Place) -> Path:
        """Path of a file named in a file of `folder`.

        Parameters
        ----------
        folder : Path
        name : str
        at : Place
            Of the name.

        Raises
        ------
        InputError
            If it lies outside, be it by its name or because it is a link, and that is not allowed; or if there is none.
        """
        path = folder / name
        if self.outside or self._inside(path):
            if not os.path.lexists(path) and name.isprintable():  # a name that no file can have is told when it is read
                raise at.error(f"{path}: there is no such file{similar_names(path)}")
            return path
        shown = name if len(name) <= 80 else f"{name[:77]}..."
        raise at.error(
            f'"{shown}" lies outside the folder of {self.file.name}; move it there, or write {ALLOW} = true at the top '
            f"of {self.file.name} if you know where it comes from"
        )

    def _inside(self, path: Path) -> bool:
        # both with their links followed: a folder that is itself a link stays the folder that was meant
        root = os.path.realpath(self.file.parent)
        return Path(os.path.realpath(path)).is_relative_to(root)
