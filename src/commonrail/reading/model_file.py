"""TOML file that names other files: read, checked, and with the folder that those may lie in."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar

from commonrail.reading.faults import read_model
from commonrail.reading.fields import FileModel
from commonrail.reading.place import Place
from commonrail.reading.reach import Reach
from commonrail.reading.toml_file import read_toml

__all__ = ["ModelFile", "read_model_file"]

_FileContent = TypeVar("_FileContent", bound=FileModel)


class ModelFile(NamedTuple, Generic[_FileContent]):
    """Content of a file.

    Attributes
    ----------
    model : FileModel
    at : Place
        The file, for messages.
    reach : Reach
        Where the files that it names may lie.
    text : str
        The file as given.
    """

    model: _FileContent
    at: Place
    reach: Reach
    text: str


def read_model_file(kind: type[_FileContent], file: Path) -> ModelFile[_FileContent]:
    """Read and check a file.

    Parameters
    ----------
    kind : type
        Model of the file, with the key `allow_outside`.
    file : Path

    Raises
    ------
    InputError
        If it cannot be read, or something in it is unknown, missing or of the wrong kind.
    """
    document, text = read_toml(file)
    at = Place(str(file))
    model: Any = read_model(kind, document, at)
    return ModelFile(model, at, Reach(file, model.allow_outside), text)
