"""A fit that survives: kept step by step in its run folder, and resumed after whatever stopped it.

All kinds of fit run here; `FitKind` states their differences. `calibrate_into` and `resume` run the study of an
injector.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar

from commonrail.base.arguments import file_path, flag, instance, integer, thread_count
from commonrail.base.errors import CommonrailError, ConfigurationError, StudyError
from commonrail.base.hooks import hold_interrupts
from commonrail.base.input import SUMS, sha256
from commonrail.base.output import PART, write_set, write_text, writing
from commonrail.base.text import command
from commonrail.calibration.identifiability import Identified, identify
from commonrail.calibration.objective import Objective
from commonrail.calibration.optimisers.base import MOST_GENERATIONS
from commonrail.calibration.plausibility import Finding
from commonrail.calibration.refits import refits_of
from commonrail.calibration.run import Calibration, at_values, calibrate
from commonrail.calibration.search import Checkpoint, CheckpointError, Progress, Searched
from commonrail.calibration.study import Study, objective_of
from commonrail.calibration.study_file import load_study
from commonrail.runs.copies import copy_files, copy_paths, set_in_text
from commonrail.runs.fingerprint import check_files, hash_study, other_targets
from commonrail.runs.folder import STUDY, Results, refuse_used, write_results
from commonrail.runs.journal import ESTIMATED, JOURNAL, STARTS, Input, Journal, RunJournal, State, read_about

if TYPE_CHECKING:
    from commonrail.workers.workers import Workers


class Fitted(Protocol):
    """Result of a fit."""

    @property
    def status(self) -> str:
        """ "finished" or "interrupted"."""

    @property
    def reason(self) -> str:
        """Reason for its end."""


class Settings(Searched, Protocol):
    """Settings of a fit, a frozen dataclass."""

    @property
    def files(self) -> Mapping[Path, str]:
        """SHA-256 of each file that it was read from, its own first; empty if it was made in Python."""

    @property
    def text(self) -> str:
        """Its file as given."""

    @property
    def as_read(self) -> Any:
        """Settings of this class as the files state them; None if they were made in Python."""


_Study = TypeVar("_Study", bound=Settings)
_Fit = TypeVar("_Fit", bound=Fitted)
Work = Callable[[_Study, Journal, Checkpoint | None], _Fit]  # searches, and writes the result into the run folder


@dataclass(frozen=True, kw_only=True)
class FitKind(Generic[_Study, _Fit]):
    """Fits of one kind in run folders.

    Attributes
    ----------
    file : str
        Name of the file with the settings in a run folder.
    word, command, again : str
        For messages: what the settings are called, the command that begins a run, and the call that resumes one whose
        settings were made in Python.
    load : function of Path
        Settings of a file.
    content : function of the settings
        Fingerprint: equal fingerprints mean identical searches, except for their length.
    results : tuple of str
        Names of the files that a run writes, in small letters: inputs with such a name are kept apart.
    options : tuple of str
        Fields of the settings, each a key of the file, that options of the command may have changed.
    """

    file: str
    word: str
    command: str
    again: str
    load: Callable[[Path], _Study]
    content: Callable[[_Study], str]
    results: tuple[str, ...] = ()
    options: tuple[str, ...] = ("seed",)

    def begin(self, folder: Path, study: _Study, work: Work[_Study, _Fit]) -> _Fit:
        """Fit into a new or empty folder; nothing stays in it if nothing was simulated.

        `InputError` if the folder is not empty, `OutputError` if it cannot be written; what was done before is kept.
        """
        existed = folder.is_dir()
        copies = self.copies(study)
        check_free(folder, copies)
        with writing(folder):
            folder.mkdir(parents=True, exist_ok=True)
        with Journal(folder) as journal:
            if journal.has_begun:
                refuse_used(folder)
            try:
                inputs, settings, content = self.copy(study, folder)
                facts = {"title": study.title, "given": study.text, "study": settings.text, "content": content}
                journal.describe_files(facts | {"generations": str(_generations(settings))}, inputs)
                return run_session(journal, lambda: work(settings, journal, None))
            except BaseException:
                if journal.is_in_place and journal.checkpoint() is None:
                    _remove(folder, copies, existed)
                raise

    def resume(
        self,
        folder: Path,
        work: Work[_Study, _Fit],
        *,
        study: _Study | None = None,
        generations: int = 0,
        as_begun: bool = False,
    ) -> _Fit:
        """Go on with a run, with `generations` more than its settings ask for.

        Settings that were made in Python must be passed again. With `as_begun`, the copies in the folder are used
        although the original files have changed. `StudyError` if there is no journal, another process is at work in the
        folder, or the settings or their files have changed; `OutputError` if the folder cannot be written.
        """
        if not (folder / JOURNAL).is_file():
            raise StudyError(self._nothing_to_resume(folder))
        with Journal(folder) as journal:
            if not journal.has_begun or not all(item.name == self.file for item in journal.inputs[:1]):
                raise StudyError(self._nothing_to_resume(folder))
            check_files(journal, as_begun)
            settings = self._begun_with(journal, study)
            with write_set(folder, inputs={item.name: item.copy for item in journal.inputs}):
                pass  # as they are in the journal, if the checksums were lost or are those of an earlier version
            if generations:
                settings = _extend(journal, settings, generations)
            checkpoint = journal.checkpoint()
            return run_session(journal, lambda: work(settings, journal, checkpoint))

    def copies(self, study: _Study) -> list[str]:
        """Names of the files that `copy` will write into a run folder."""
        return [place.as_posix() for place in copy_paths(study.files, self.file, self.results).values()]

    def copy(self, study: _Study, folder: Path) -> tuple[list[Input], _Study, str]:
        """Copy the files of settings into a run folder; return the copies, the settings in them and a fingerprint.

        Without copies, the given settings are used: if they were made in Python, or changed there beyond `options` and
        the number of generations. `StudyError` if a file has changed since it was read.
        """
        content, as_read = self.content(study), study.as_read
        if as_read is None:
            return [], study, content
        options: dict[str, Any] = {name: getattr(study, name) for name in self.options}
        total, text = _generations(study), study.text
        settings: _Study = _with_generations(_change(as_read, **options), total)
        if text != as_read.text or self.content(settings) != content:
            return [], study, content
        for name, value in options.items():
            if value != getattr(as_read, name):
                text = set_in_text(text, (name,), value)
        if total != _generations(as_read):
            text = set_in_text(text, ("optimiser", "generations"), total)
        with write_set(folder):
            places = copy_paths(study.files, self.file, self.results)
            inputs, text = copy_files(study.files, folder, places, text)
        files = {folder.absolute() / item.name: item.copy for item in inputs}
        return inputs, _change(settings, files=files, text=text), content

    def _nothing_to_resume(self, folder: Path) -> str:
        if not folder.is_dir():
            return f"{folder}: this is no folder of a run; `commonrail runs DIR` lists the runs below a folder."
        return (
            f"{folder}: there is no run to go on with; `{command('runs', folder)}` lists those in it, "
            f"and `{self.command}` begins one."
        )

    def _begun_with(self, journal: Journal, study: _Study | None) -> _Study:
        """The settings of a run, as they were."""
        if journal.inputs:
            study = self.load(journal.folder / self.file)
            if _generations(study) != journal.generations:
                raise StudyError(
                    f"{journal.path}: the journal is damaged: it asks for {journal.generations} generations and "
                    f"{self.file} for {_generations(study)}; use an intact copy."
                )
        elif study is None:
            raise StudyError(
                f"{journal.folder}: the {self.word} of this run was made in Python, no file has it; make it there "
                f"again and go on with {self.again}."
            )
        study = _with_generations(study, journal.generations)
        if self.content(study) != journal.about["content"]:
            raise StudyError(
                f"{journal.folder}: the {self.word} reads differently from when the run was begun, although its files "
                "are the same; go on with the version of commonrail that began it, or begin a new run."
            )
        return study


def run_session(journal: RunJournal, work: Callable[[], _Fit]) -> _Fit:
    """Work on a run of any kind; the journal notes what ended the session too early, if that can still be done."""
    journal.start_session()
    with hold_interrupts():  # once the search has ended, its result is written whatever keys are hit
        try:
            fit = work()
            journal.end_session(fit.status, fit.reason)
            return fit
        except CheckpointError as error:
            raise StudyError(f"{journal.path}: {error}") from error
        except BaseException as error:
            stopped = isinstance(error, KeyboardInterrupt)
            with suppress(CommonrailError):
                journal.end_session(State.INTERRUPTED if stopped else State.FAILED, "" if stopped else str(error))
            raise


def check_free(folder: Path, copies: Sequence[str] = (), journal: type[RunJournal] = Journal) -> None:
    """Refuse a folder in use; files of a run with these copies that was killed before it started are accepted."""
    if not folder.is_dir():
        refuse_used(folder)
        return
    left = _begin_of_names(journal)
    own_copies: set[Path] = set()
    with suppress(StudyError):
        own_copies = set() if "content" in read_about(folder) else {folder / name for name in copies}
    files = (path for path in folder.rglob("*") if path.is_symlink() or not path.is_dir())
    if any(not (path in own_copies or path.name.startswith(left) or path.suffix == PART) for path in files):
        refuse_used(folder)


def _begin_of_names(journal: type[RunJournal]) -> tuple[str, ...]:
    """Beginnings of the names of a run's own files: SQLite adds to them."""
    return journal.NAME, journal.LOCK, SUMS


def _remove(folder: Path, copies: Sequence[str], existed: bool) -> None:
    """Take away what a run has put into a folder, and nothing else."""
    with suppress(OSError):
        for path in [folder / name for name in copies] + [
            path for path in folder.iterdir() if path.name.startswith(_begin_of_names(Journal))
        ]:
            path.unlink(missing_ok=True)
        for place in sorted({folder / parent for name in copies for parent in Path(name).parents[:-1]}, reverse=True):
            place.rmdir()
        if not existed:
            folder.rmdir()


def _generations(study: Settings) -> int:
    """Generations of the first optimiser after its initial population."""
    return study.method.evolution.generations


def _with_generations(study: _Study, generations: int) -> _Study:
    evolution = replace(study.method.evolution, generations=generations)
    return _change(study, method=replace(study.method, evolution=evolution))


def _change(study: _Study, **fields: Any) -> _Study:
    changed: _Study = replace(study, **fields)  # type: ignore[type-var]
    return changed


def _extend(journal: Journal, study: _Study, more: int) -> _Study:
    """The settings with more generations, in journal and file too."""
    total = journal.generations + more
    if total > MOST_GENERATIONS:
        raise ConfigurationError(
            f"generations: {more} more than the run's {journal.generations} are {total}, and at most "
            f"{MOST_GENERATIONS} are allowed; ask for fewer."
        )
    longer = _with_generations(study, total)
    facts = {"generations": str(total)}
    inputs = journal.inputs
    if inputs:
        facts["study"] = set_in_text(study.text, ("optimiser", "generations"), total)
        facts["before"] = inputs[0].copy
        inputs[0] = inputs[0]._replace(copy=sha256(facts["study"].encode()))
        longer = _change(longer, text=facts["study"])
    journal.describe_files(facts, inputs)
    if inputs:
        with write_set(journal.folder):
            write_text(journal.folder / inputs[0].name, facts["study"])
        journal.describe({"before": ""})
    return longer


@dataclass(frozen=True)
class Listener:
    """Functions called after every generation and refinement, with sentences for the user, and with the written files.

    `written` is called with the results of the finished run of a study.
    """

    progress: Callable[[Progress], None] = lambda _: None
    note: Callable[[str], None] = lambda _: None
    written: Callable[[Results], None] = lambda _: None


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
    KeyboardInterrupt
        At Ctrl-C before a candidate was simulated, or after the search; then the fit is kept, and `resume` assesses it.

    Notes
    -----
    Warnings go to `listener.note` when they occur, and are in the result.
    """
    path = file_path(folder, "folder")
    instance(study, Study, "study")
    return STUDIES.begin(path, study, _work(listener, threads, workers, strict=flag(strict, "strict")))


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
    """Continue a stopped run; the result is bit for bit the same as without the stop.

    Parameters
    ----------
    folder : str or Path
        Run folder; it may have been moved or copied.
    generations : int
        More generations of the evolution than the study asks for; refinements are then repeated.
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
    generations = integer(generations, "generations")
    if study is not None:
        instance(study, Study, "study")
    flag(as_begun, "as_begun")
    work = _work(listener, threads, workers)
    return STUDIES.resume(path, work, study=study, generations=generations, as_begun=as_begun)


def estimate_again(
    folder: str | Path, *, starts: int, threads: int | None = None, listener: Listener = Listener()
) -> Calibration:
    """Search the most likely values of a finished run again, from `starts` starts, and redo all that depends on them.

    Arguments and errors as for `resume`. A later `resume` uses this number of starts.
    """
    path = file_path(folder, "folder")
    return STUDIES.resume(path, _work(listener, threads, None, starts=integer(starts, "starts", 1)), as_begun=True)


def _work(
    listener: Listener, threads: int | None, workers: Workers | None, *, strict: bool = False, starts: int = 0
) -> Work[Study, Calibration]:
    """Calibrate, judge the fit and write both; wrong settings are refused before anything is written.

    `starts`: of the search for the most likely values, 0 for those of the run. Ctrl-C in the judgement raises
    `KeyboardInterrupt`: the fit is kept, and `resume` judges it.
    """
    if workers is not None:
        from commonrail.workers.workers import Workers

        instance(workers, Workers, "workers")
    instance(listener, Listener, "listener")
    threads = thread_count(threads)

    def work(study: Study, journal: Journal, checkpoint: Checkpoint | None) -> Calibration:
        before = warn_of_targets(journal, study, checkpoint, lambda: objective_of(study, threads), listener)
        calibration = calibrate(
            study,
            threads=threads,
            workers=workers,
            progress=listener.progress,
            recorder=journal,
            checkpoint=checkpoint,
            warn=lambda finding: listener.note(f"warning: {finding.sentence}"),
            strict=strict,
        )
        calibration = replace(calibration, warnings=before + calibration.warnings)
        journal.check_place()
        listener.note("judging how well the data determine each parameter ...")
        many = starts or int(journal.about.get(STARTS) or 1)
        try:
            with hold_interrupts() as stop:
                if calibration.status == State.INTERRUPTED:
                    stop.asked = False  # that was the search; its best values are judged
                identified = identify(calibration, threads, starts=many)
                refits = refits_of(calibration, threads=threads, workers=workers, note=listener.note)
            if identified.estimate:
                adopted = at_values(calibration, identified.estimate, threads)
                calibration = replace(adopted, warnings=before + adopted.warnings)
        except BaseException:
            journal.check_place()
            write_results(journal.folder, calibration, Identified())  # the fit is kept without its judgement
            raise
        identified.sections |= {"refits": refits} if refits else {}
        journal.check_place()
        facts = {STARTS: str(many)} if starts else {}
        journal.describe(facts | {ESTIMATED: repr(calibration.cost) if identified.estimate else ""})
        listener.written(write_results(journal.folder, calibration, identified))
        if refits.get("interrupted"):
            raise KeyboardInterrupt
        return calibration

    return work


def warn_of_targets(
    journal: Journal,
    study: Searched,
    checkpoint: Checkpoint | None,
    objective: Callable[[], Objective],
    listener: Listener,
) -> tuple[Finding, ...]:
    """Warnings, also sent to the listener, if a search resumes with a different compiler target."""
    findings = other_targets(journal, study, objective()) if checkpoint is not None else ()
    for finding in findings:
        listener.note(f"warning: {finding.sentence}")
    return findings


STUDIES: FitKind[Study, Calibration] = FitKind(
    file=STUDY,
    word="study",
    command="commonrail calibrate STUDY",
    again="commonrail.resume(folder, study=study)",
    load=load_study,
    content=hash_study,
)
