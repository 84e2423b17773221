"""A calibration that survives: kept step by step in its run folder, and taken up again after whatever stopped it."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

from commonrail.base.arguments import file_path, flag, instance, thread_count, whole
from commonrail.base.errors import CommonrailError, ConfigurationError, StudyError
from commonrail.base.input import sha256
from commonrail.base.output import PART, write_text, writing
from commonrail.calibration.identifiability import identify
from commonrail.calibration.optimisers.base import MOST_GENERATIONS
from commonrail.calibration.run import Calibration, calibrate
from commonrail.calibration.search import Checkpoint, CheckpointError, Progress, objective_of
from commonrail.calibration.seeds import refits_of
from commonrail.calibration.study import Method, Study
from commonrail.calibration.study_file.file import load_study
from commonrail.runs.copies import (
    check_files,
    copies_of,
    copy_apart,
    copy_study,
    places_apart,
    set_in_copy,
    set_in_study,
    with_generations,
)
from commonrail.runs.fingerprint import content_of, other_targets
from commonrail.runs.folder import STUDY, refuse_used, write_judgement, write_results
from commonrail.runs.journal import JOURNAL, LOCK, Input, Journal, State, read_about
from commonrail.runs.lock import trusted
from commonrail.workers.interrupt import held_interrupts
from commonrail.workers.workers import Workers

# Beginning and end of a run in its folder: what a run has put there goes away if nothing was simulated.

_Own = TypeVar("_Own")

_LEFT = (JOURNAL, LOCK)  # and what SQLite puts beside them


@dataclass(frozen=True)
class Copied(Generic[_Own]):
    """Files that a run reads, in its folder.

    Attributes
    ----------
    own : object
        What is run, read from the copies.
    facts : mapping of str to str
        Facts for the journal.
    inputs : sequence of Input
        The copies.
    """

    own: _Own
    facts: Mapping[str, str]
    inputs: Sequence[Input]


@contextmanager
def begun(folder: Path, copies: Sequence[str], copied: Callable[[], Copied[_Own]]) -> Iterator[tuple[Journal, _Own]]:
    """A new run's journal and what is run; nothing stays if nothing was simulated.

    Parameters
    ----------
    folder : Path
        New or empty.
    copies : sequence of str
        Names of the files that `copied` will write.
    copied : function
        Writes the copies.
    """
    existed = folder.is_dir()
    _check_free(folder)
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    with Journal(folder) as journal:
        if "content" in journal.about:
            refuse_used(folder)
        journal.describe({"copies": json.dumps(list(copies))})
        try:
            found = copied()
            journal.describe(found.facts, list(found.inputs))
            yield journal, found.own
        except BaseException:
            if journal.is_in_place and journal.checkpoint() is None:
                _remove(folder, copies, existed)
            raise


@contextmanager
def ending(journal: Journal) -> Iterator[None]:
    """Note in the journal what ended a run too early, if that can still be done."""
    try:
        yield
    except CheckpointError as error:
        raise StudyError(f"{journal.path}: {error}") from error
    except BaseException as error:
        stopped = isinstance(error, KeyboardInterrupt)
        with suppress(CommonrailError):
            journal.end_session(State.INTERRUPTED if stopped else State.FAILED, "" if stopped else str(error))
        raise


def _check_free(folder: Path) -> None:
    """Refuse a folder in use, but not what a run left that was killed before it was ready to start."""
    if not (folder / LOCK).is_file():
        refuse_used(folder)
        return
    copies: list[str] = []
    with suppress(StudyError):
        about = read_about(folder)
        with trusted(folder / JOURNAL):
            copies = [] if "content" in about else [str(name) for name in json.loads(about.get("copies", "[]"))]
    own = {folder / name for name in copies}
    files = [path for path in folder.rglob("*") if not path.is_dir()]
    if any(not (path in own or path.name.startswith(_LEFT) or path.suffix == PART) for path in files):
        refuse_used(folder)


def _remove(folder: Path, copies: Sequence[str], existed: bool) -> None:
    """Take away what a run has put into a folder, and nothing else."""
    with suppress(OSError):
        for path in [folder / name for name in copies] + [p for p in folder.iterdir() if p.name.startswith(_LEFT)]:
            path.unlink(missing_ok=True)
        for place in sorted({folder / parent for name in copies for parent in Path(name).parents[:-1]}, reverse=True):
            place.rmdir()
        if not existed:
            folder.rmdir()


# A fit that survives: a search of any kind, kept step by step in its run folder, and resumed wherever it stopped.
#
# The studies of one injector have more of their own, in `commonrail.runs.fit`; families and foreign FMUs share this.


class Fittable(Protocol):
    """Settings of a fit, a frozen dataclass; see `commonrail.plugins.family.study.Family` for one."""

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


@dataclass(frozen=True)
class Listener:
    """Listeners to the progress of a run.

    Attributes
    ----------
    progress : function of Progress
        Called after every generation and refinement.
    note : function of str
        Called with sentences for the user.
    """

    progress: Callable[[Progress], None] = lambda _: None
    note: Callable[[str], None] = lambda _: None


def calibrate_into(
    folder: str | Path,
    study: Study,
    *,
    threads: int | None = None,
    workers: Workers | None = None,
    listener: Listener = Listener(),
    strict: bool = False,
) -> Calibration:
    """Calibrate a study into a new run folder that keeps every step; `resume` goes on from wherever it was stopped.

    Parameters
    ----------
    folder : str or Path
        New or empty.
    study : Study
    threads : int, optional
        All usable processors by default; the result does not depend on it.
    workers : Workers, optional
        Processes or a cluster that simulate in place of threads; the result is the same.
    listener : Listener, optional
    strict : bool
        Refuse a study that gives a warning before the search begins; nothing is left in the folder then.

    Returns
    -------
    Calibration
        Its result is in the folder too: study.toml with all files that it reads, calibrated.toml, result.json,
        traces.csv, SHA256SUMS, journal.sqlite.

    Raises
    ------
    ConfigurationError
        If an argument is of another kind, such as a path in place of a study.
    InputError
        If the folder is not empty.
    OutputError
        If it cannot be written; what was done before is kept.
    StudyError
        If the study cannot be run; what was done before is kept.

    Notes
    -----
    Warnings are told to `listener.note` when they are found, and are in the result.
    """
    path = file_path(folder, "folder")
    instance(study, Study, "study")
    strict = flag(strict, "strict")
    threads = _check_how(threads, workers, listener)
    with _begun(path, study) as (journal, own):
        return _run(journal, own, None, listener, threads=threads, workers=workers, strict=strict)


def resume(
    folder: str | Path,
    *,
    generations: int = 0,
    study: Study | None = None,
    as_begun: bool = False,
    threads: int | None = None,
    workers: Workers | None = None,
    listener: Listener = Listener(),
) -> Calibration:
    """Go on with a run that was stopped, however it was; the result is that of a run never stopped, bit by bit.

    Parameters
    ----------
    folder : str or Path
        Run folder; it may have been moved or copied.
    generations : int
        More generations of the evolution than the study asks for; refinements are then done anew.
    study : Study, optional
        The study, if it was made in Python and not read from a file.
    as_begun : bool
        Go on with the copies in the run folder although the files that they were made from have changed.
    threads, workers, listener
        As in `calibrate_into`; they may differ from those of the beginning.

    Raises
    ------
    StudyError
        If there is no journal, another process is at work in the folder, or the study or its data have changed.
    OutputError
        If the folder cannot be written; what was done before is kept.
    ConfigurationError
        If `generations` is negative, has a fraction or asks for too many, or an argument is of another kind.
    """
    path = file_path(folder, "folder")
    generations = whole(generations, "generations")
    if study is not None:
        instance(study, Study, "study")
    flag(as_begun, "as_begun")
    threads = _check_how(threads, workers, listener)
    if not (path / JOURNAL).is_file():
        raise StudyError(_nothing_to_resume(path))
    with Journal(path) as journal:
        if "content" not in journal.about:
            raise StudyError(_nothing_to_resume(path))
        check_files(journal, as_begun)
        own = _study_of(journal, study)
        if generations:
            _check_total(journal, generations)
            own = _extended(journal, own, generations)
        return _run(journal, own, journal.checkpoint(), listener, threads=threads, workers=workers)


def _check_how(threads: int | None, workers: Workers | None, listener: Listener) -> int | None:
    """Refuse wrong settings before anything is written."""
    if workers is not None:
        instance(workers, Workers, "workers")
    instance(listener, Listener, "listener")
    return thread_count(threads)


def _run(journal: Journal, study: Study, checkpoint: Checkpoint | None, listener: Listener, **how: Any) -> Calibration:
    before = other_targets(journal, study, objective_of(study, how["threads"])) if checkpoint is not None else ()
    for finding in before:
        listener.note(f"warning: {finding.sentence}")
    journal.start_session()
    with held_interrupts(), ending(journal):  # once the search has ended, its result is written whatever keys are hit
        calibration = calibrate(
            study,
            progress=listener.progress,
            recorder=journal,
            checkpoint=checkpoint,
            warn=lambda finding: listener.note(f"warning: {finding.sentence}"),
            **how,
        )
        calibration = replace(calibration, warnings=before + calibration.warnings)
        journal.check_place()
        write_results(journal.folder, calibration, {})  # the fit is kept whatever happens to its judgement
        listener.note("judging how well the data determine each parameter ...")
        identified = identify(calibration, how["threads"])
        workers = how["workers"]
        refits = refits_of(calibration, threads=how["threads"], workers=workers, note=listener.note)
        identified.sections |= {"refits": refits} if refits else {}
        journal.check_place()
        write_judgement(journal.folder, calibration, identified)
        journal.end_session(calibration.status, calibration.reason)
    return calibration


@contextmanager
def _begun(folder: Path, study: Study) -> Iterator[tuple[Journal, Study]]:
    """A new run's journal and its study, read from the copy in the folder; nothing stays if nothing was simulated."""

    def copied() -> Copied[Study]:
        inputs, own, content = copy_study(study, folder)
        facts = {
            "title": study.title,
            "given": study.text,
            "study": own.text,
            "content": content,
            "generations": str(own.method.evolution.generations),
        }
        return Copied(own, facts, inputs)

    with begun(folder, copies_of(study), copied) as (journal, own):
        yield journal, own


def _nothing_to_resume(folder: Path) -> str:
    if not folder.is_dir():
        return f"{folder}: this is no folder of a run; `commonrail runs DIR` lists the runs below a folder."
    return (
        f"{folder}: there is no run to go on with; `commonrail runs {folder}` lists those in it, and "
        "`commonrail calibrate STUDY` begins one."
    )


def _study_of(journal: Journal, given: Study | None) -> Study:
    """The study of a run, as it was."""
    about = journal.about
    if journal.inputs:
        given = load_study(journal.folder / STUDY)
        if (own := given.method.evolution.generations) != journal.generations:
            raise StudyError(
                f"{journal.path}: the journal is damaged: it asks for {journal.generations} generations and {STUDY} "
                f"for {own}; take a copy of it that is whole."
            )
    elif given is None:
        raise StudyError(
            f"{journal.folder}: the study of this run was made in Python, no file has it; make it there again and go "
            "on with commonrail.resume(folder, study=study)."
        )
    study = with_generations(given, journal.generations)
    if content_of(study) != about["content"]:
        raise StudyError(
            f"{journal.folder}: the study reads differently from when the run was begun, although its files are the "
            "same; go on with the version of commonrail that began it, or begin a new run."
        )
    return study


def _check_total(journal: Journal, more: int) -> None:
    total = journal.generations + more
    if total > MOST_GENERATIONS:
        raise ConfigurationError(
            f"generations: {more} more than the run's {journal.generations} are {total}, and at most "
            f"{MOST_GENERATIONS} are allowed; ask for fewer."
        )


def _extended(journal: Journal, study: Study, more: int) -> Study:
    """The study with more generations."""
    total = study.method.evolution.generations + more
    longer = with_generations(study, total)
    facts = {"generations": str(total)}
    inputs = journal.inputs
    if inputs:
        facts["study"] = set_in_study(study.text, ("optimiser", "generations"), total)
        facts["before"] = inputs[0].copy
        inputs[0] = inputs[0]._replace(copy=sha256(facts["study"].encode()))
        longer = replace(longer, text=facts["study"])
    journal.describe(facts, inputs)
    if inputs:
        write_text(journal.folder / STUDY, facts["study"])
        journal.describe({"before": ""})
    return longer
