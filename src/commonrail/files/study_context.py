"""Surroundings of every data set of a study: the injector, the time step and where its files may lie."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager
from typing import NamedTuple

from commonrail.files.place import Place, located
from commonrail.files.reach import Reach
from commonrail.files.tables import Table, Units, read_columns
from commonrail.injector.definition import Injector
from commonrail.kinds import reading

__all__ = ["StudyContext"]


class StudyContext(NamedTuple):
    """What a kind of data reads a data set with, see `kinds.reading.Context`; time step in s."""

    injector: Injector
    time_step: float
    reach: Reach

    def columns(
        self,
        file: str,
        at: reading.Place,
        wanted: Mapping[str, Units],
        *,
        stated: Mapping[str, str | None],
        increasing: str = "",
        least: int = reading.LEAST_SAMPLES,
    ) -> Table:
        """Named columns of a file; InputError if it lies where the study may not look.

        Parameters
        ----------
        file : str
            Its name in the study.
        at : Place
            Of the block that names it with the key "file".
        wanted, stated, increasing, least
            As for `read_columns`.
        """
        path = self.reach.path(self.reach.file.parent, file, Place(str(at / "file")))
        return read_columns(path, wanted, stated=stated, increasing=increasing, least=least)

    def located(self, at: reading.Place | str) -> AbstractContextManager[None]:
        """Put the place before the message of any error of the project raised inside."""
        return located(Place(str(at)))
