"""A calibration that survives: kept step by step in its run folder, and taken up again after whatever stopped it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from commonrail.analysis.identifiability import identify
from commonrail.analysis.refits import refits_of
from commonrail.arguments import file_path, flag, instance, thread_count, whole
from commonrail.calibration.checkpoint import Checkpoint
from commonrail.calibration.optimisers.base import MOST_GENERATIONS
from commonrail.calibration.run import Calibration, calibrate
from commonrail.calibration.search import Progress, objective_of
from commonrail.calibration.study import Study
from commonrail.errors import ConfigurationError, StudyError
from commonrail.files.atomic import write_text
from commonrail.files.run_folder import STUDY, write_judgement, write_results
from commonrail.files.study_file import load_study
from commonrail.reading.guarded_file import sha256
from commonrail.store.beginning import Copied, begun, ending
from commonrail.store.changes import check_files
from commonrail.store.content import content_of
from commonrail.store.copies import copies_of, copy_study, set_in_study, with_generations
from commonrail.store.journal import JOURNAL, Journal
from commonrail.store.targets import other_targets
from commonrail.workers.interrupt import held_interrupts
from commonrail.workers.workers import Workers

__all__ = ["Listener", "calibrate_into", "resume"]


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
