"""Files that belong to a run folder, and that no other output may take the place of."""

from __future__ import annotations

import sqlite3
from contextlib import suppress
from pathlib import Path

from commonrail.errors import CommonrailError, InputError
from commonrail.files.sums import SUMS, listed
from commonrail.store.copies import RESERVED
from commonrail.store.journal import JOURNAL
from commonrail.store.journal_file import opened_to_read
from commonrail.store.run_schema import RUN
from commonrail.store.seals import rows_of

__all__ = ["refuse_file_of_run"]

DEEPEST = 4  # folders above a file in which a run is looked for: copies of data files lie below its folder


def refuse_file_of_run(path: Path, option: str) -> None:
    """Refuse to replace a result, the journal or a copied input of a run; other files in its folder may be replaced.

    Parameters
    ----------
    path : Path
    option : str
        Option of the command line that named it.

    Raises
    ------
    InputError
        If there is such a file at this path.
    """
    if not path.exists():
        return
    whole = path.absolute()
    for folder in whole.parents[:DEEPEST]:
        if _is_own(folder, whole.relative_to(folder).as_posix()):
            raise InputError(f"{option}: {path} is a file of the run in {folder}; name another file.")


def _is_own(folder: Path, name: str) -> bool:
    """True for the name of a file that the run in a folder has written or copied."""
    has_sums, has_journal = (folder / SUMS).is_file(), (folder / JOURNAL).is_file()
    if not (has_sums or has_journal):
        return False
    own = set(listed(folder / SUMS)) if has_sums else set()
    with suppress(CommonrailError, sqlite3.Error):  # a damaged journal is not this command's affair
        own |= _copied(folder / JOURNAL) if has_journal else set()
    return name in own or name.lower() in RESERVED


def _copied(journal: Path) -> set[str]:
    """Names of the copies of input files."""
    with opened_to_read(journal, RUN) as connection:
        return {str(name) for name, *_ in rows_of(connection, "input")}
