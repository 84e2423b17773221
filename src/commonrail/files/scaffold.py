"""A folder to start from: a commented injector, a study and an example curve, which the user replaces."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from commonrail.errors import InputError
from commonrail.files.atomic import writing

__all__ = ["TEMPLATES", "write_new"]

# Names below `templates`, in the order in which a person reads them.
TEMPLATES = ("README.md", "injector.toml", "study.toml", "data/evi.csv")


def write_new(folder: Path) -> list[Path]:
    """Write an injector, a study, an example curve and a README into a new or empty folder.

    Parameters
    ----------
    folder : Path

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    InputError
        If something is there already; nothing is overwritten.
    OutputError
        If the folder cannot be written.
    """
    templates = resources.files("commonrail.files") / "templates"
    with writing(folder):
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise InputError(f"{folder}: there already is something; name a new or empty folder.")
        written = []
        for name in TEMPLATES:
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes((templates / name).read_bytes())
            written.append(path)
    return written
