"""Injectors from TOML: a file of the user, or the catalogue that ships with the package.

One table per room, whose keys are the room's parameters. A value is a text with its unit, or an inline
table that adds mark and source; what a file leaves out takes the default of the room.
"""

from __future__ import annotations

from pathlib import Path

from commonrail.arguments import file_path, source_of
from commonrail.files.catalogue import Catalogue
from commonrail.files.injector_model import injector_of, meters_of
from commonrail.files.injector_writer import dump_injector
from commonrail.files.sums import check_sum
from commonrail.injector.definition import Injector
from commonrail.observation.meter import Meter
from commonrail.reading.place import Place
from commonrail.reading.reach import Reach
from commonrail.reading.text_file import read_text
from commonrail.reading.toml_file import LARGEST_TOML, parse_toml, read_toml

__all__ = ["dump_injector", "injector_catalogue", "load_injector", "load_meters"]


_CATALOGUE = Catalogue("commonrail.injector", "catalogue", 'There is no injector "{}" in the catalogue')


def injector_catalogue() -> list[str]:
    """Names that `load_injector` knows, sorted."""
    return _CATALOGUE.names()


def load_injector(source: str | Path, reach: Reach | None = None) -> Injector:
    """Read an injector.

    Parameters
    ----------
    source : str or Path
        Path of a ``.toml`` file, or a name of `injector_catalogue`.
    reach : Reach, optional
        Where the file of its fuel may lie; by default in the injector's folder or below, unless the injector's file
        says ``allow_outside = true``.

    Returns
    -------
    Injector
        Every value in SI, with mark and source.

    Raises
    ------
    InputError
        If the file cannot be read or something in it is unknown, missing, of the wrong kind or outside
        its domain, with file and key; or if it is a result that is not the one that was written.
    ConfigurationError
        If `source` is neither a name nor a path.
    """
    source = source_of(source, "source of an injector")
    if isinstance(source, Path):
        check_sum(source)
        return _read(read_text(source, LARGEST_TOML), str(source), source.stem, reach)
    file = f"{source}.toml"
    return _read(_CATALOGUE.text(source, _similar(file, reach)), file, source, Reach(Path(file), False))


def _read(text: str, file: str, stem: str, reach: Reach | None) -> Injector:
    return injector_of(parse_toml(text, file), Place(file), stem, reach)


def load_meters(path: str | Path) -> tuple[Meter, ...]:
    """Read the meters that a calibration has left beside its injector, in ``calibrated.toml``.

    Parameters
    ----------
    path : str or Path
        Injector file.

    Returns
    -------
    tuple of Meter
        Empty if there are none.

    Raises
    ------
    InputError
        If the file cannot be read, or something in it is unknown or of the wrong kind.
    ConfigurationError
        If `path` is no path, or a meter makes no sense.
    """
    file = file_path(path, "path of an injector")
    return meters_of(read_toml(file)[0], Place(str(file)))


def _similar(file: str, reach: Reach | None) -> str:
    """Suggestion of a file of that name, if there is one."""
    try:
        there = ((reach.file.parent if reach else Path()) / file).is_file()
    except (OSError, ValueError):  # a name that no file can have
        there = False
    return f' (did you mean the file "{file}"?)' if there else ""
