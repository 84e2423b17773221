"""A fit that survives: a search of any kind, kept step by step in its run folder, and resumed wherever it stopped.

The studies of one injector have more of their own, in `commonrail.store.run`; families and foreign FMUs share this.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

from commonrail.calibration.checkpoint import Checkpoint
from commonrail.calibration.study import Method
from commonrail.errors import StudyError
from commonrail.store.beginning import Copied, begun, ending
from commonrail.store.changes import check_files
from commonrail.store.copies import copy_apart, places_apart, set_in_copy
from commonrail.store.journal import JOURNAL, Journal
from commonrail.workers.interrupt import held_interrupts

__all__ = ["Fittable", "Fitted", "FolderFit", "FolderWords"]


class Fittable(Protocol):
    """Settings of a fit, a frozen dataclass; see `commonrail.family.study.Family` for one."""

    @property
    def title(self) -> str:
        """Title in messages."""

    @property
    def method(self) -> Method:
        """Settings of the optimisers."""

    @property
    def files(self) -> Mapping[Path, str]:
        """SHA-256 of each file that it was read from, its own first; empty if it was made in Python."""

    @property
    def text(self) -> str:
        """Its file as given."""


class Fitted(Protocol):
    """Result of a fit."""

    @property
    def status(self) -> str:
        """ "finished" or "interrupted"."""

    @property
    def reason(self) -> str:
        """Reason for its end."""


_Study = TypeVar("_Study", bound=Fittable)
_Fit = TypeVar("_Fit", bound=Fitted)
_Search = Callable[[_Study, Journal, Checkpoint | None], _Fit]


class FolderWords(NamedTuple):
    """Words of messages: for the settings ("family"), for what is fitted ("a family"), and of the two cures."""

    settings: str
    fitted: str
    command: str
    in_python: str


@dataclass(frozen=True)
class FolderFit(Generic[_Study, _Fit]):
    """Fits of one kind in run folders.

    Attributes
    ----------
    file : str
        Name of the file with the settings in a run folder.
    words : FolderWords
    load : function of Path
        Settings of a file.
    content : function of the settings
        Fingerprint: equal ones mean identical searches but for their length.
    chosen : tuple of str
        Fields of the settings, each a key of the file, that options of the command may have changed; the copy of the
        file states the changed ones, and the journal keeps all of them.
    write : function of (Path, result)
        Writes the results into a run folder.
    """

    file: str
    words: FolderWords
    load: Callable[[Path], _Study]
    content: Callable[[_Study], str]
    chosen: tuple[str, ...]
    write: Callable[[Path, _Fit], None]

    def is_run(self, folder: Path) -> bool:
        """Return whether a folder is that of such a fit."""
        return (folder / JOURNAL).is_file() and (folder / self.file).is_file()

    def begin(self, folder: Path, study: _Study, search: _Search[_Study, _Fit]) -> _Fit:
        """Fit into a new run folder.

        Parameters
        ----------
        folder : Path
            New or empty.
        study : settings
            Read from a file.
        search : function of (settings, Journal, Checkpoint or None)
            The search; its steps go into the journal.

        Raises
        ------
        InputError
            If the folder is not empty.
        OutputError
            If it cannot be written; what was done before is kept.
        StudyError
            If the settings were made in Python.
        """
        if not study.files:
            raise StudyError(
                f"{study.title}: a {self.words.settings} that was made in Python has no run folder; "
                f"use {self.words.in_python}."
            )
        with self._begun(folder, study) as (journal, own):
            return self._run(journal, own, None, search)

    def resume(
        self,
        folder: Path,
        search: _Search[_Study, _Fit],
        *,
        as_begun: bool,
        warn: Callable[[Journal, _Study], None] = lambda journal, study: None,
    ) -> _Fit:
        """Resume a fit that was stopped.

        Parameters
        ----------
        folder : Path
        search : function
            As in `begin`.
        as_begun : bool
            Use the copies in the folder although the files that they were made from have changed.
        warn : function of (Journal, settings), optional
            Called before the session begins, to say what differs from earlier ones.

        Raises
        ------
        StudyError
            If there is no journal, another process is at work in the folder, or the settings or their files have
            changed.
        OutputError
            If the folder cannot be written; what was done before is kept.
        """
        if not self.is_run(folder):
            raise StudyError(
                f"{folder}: this is no run folder of {self.words.fitted}; `{self.words.command}` begins one."
            )
        with Journal(folder) as journal:
            check_files(journal, as_begun)
            study = self._as_chosen(self.load(folder / self.file), journal.about)
            if self.content(study) != journal.about.get("content"):
                raise StudyError(
                    f"{folder}: the {self.words.settings} reads differently from when the run was begun, although its "
                    "files are the same; resume it with the version of commonrail that began it, or begin a new run."
                )
            checkpoint = journal.checkpoint()
            if checkpoint is not None:
                warn(journal, study)
            return self._run(journal, study, checkpoint, search)

    @contextmanager
    def _begun(self, folder: Path, study: _Study) -> Iterator[tuple[Journal, _Study]]:
        """A new run's journal and its settings, read from the copies in the folder."""
        chosen = {name: str(getattr(study, name)) for name in self.chosen}

        def copied() -> Copied[_Study]:
            inputs = copy_apart(study.files, folder, self.file)
            own = self.load(folder / self.file)
            wanted = {name: getattr(study, name) for name in self.chosen}
            if changed := {name: value for name, value in wanted.items() if value != getattr(own, name)}:
                inputs[0] = set_in_copy(folder, inputs[0], changed)
                own = self.load(folder / self.file)
            facts = {
                "title": study.title,
                "given": study.text,
                "study": own.text,
                "content": self.content(own),
                "generations": str(study.method.evolution.generations),
            }
            return Copied(own, facts | chosen, inputs)

        copies = [place.as_posix() for place in places_apart(study.files, self.file).values()]
        with begun(folder, copies, copied) as found:
            yield found

    def _as_chosen(self, study: _Study, facts: Mapping[str, str]) -> _Study:
        """The settings with the fields that the run was begun with."""
        begun_with = {name: type(getattr(study, name))(facts[name]) for name in self.chosen if name in facts}
        changed: Any = replace(study, **begun_with)  # type: ignore[type-var]
        found: _Study = changed
        return found

    def _run(
        self, journal: Journal, study: _Study, checkpoint: Checkpoint | None, search: _Search[_Study, _Fit]
    ) -> _Fit:
        journal.start_session()
        with (
            held_interrupts(),
            ending(journal),
        ):  # once the search has ended, its result is written whatever keys are hit
            fit = search(study, journal, checkpoint)
            journal.check_place()
            self.write(journal.folder, fit)
            journal.end_session(fit.status, fit.reason)
        return fit
