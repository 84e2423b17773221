"""Update of a run: judge new data by its prediction bands, then fit old and new data together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from commonrail.base.arguments import file_path, flag, instance, sequence, thread_count
from commonrail.base.arrays import Floats
from commonrail.base.display import Shown
from commonrail.base.errors import ConfigurationError, InputError, SimulationError, StudyError
from commonrail.base.output import write_set
from commonrail.base.record import to_record
from commonrail.base.text import command, number
from commonrail.calibration.record import CalibrationRecord, read_as
from commonrail.calibration.run import Calibration
from commonrail.calibration.scoring import score_all
from commonrail.calibration.study import Study
from commonrail.data.base import DataSet, Role, Score
from commonrail.data.curves.data import RateData
from commonrail.data.records import JUDGED
from commonrail.data.registry import of_role
from commonrail.plugins.new.study import StatedByUser
from commonrail.plugins.prediction.band import Band
from commonrail.plugins.prediction.run import LEVEL, predict
from commonrail.plugins.update.page import update_lines
from commonrail.plugins.update.record import (
    RECORD,
    Agreement,
    Baseline,
    ChangedError,
    ErrorSize,
    MovedParameter,
    NewData,
    UpdateRecord,
)
from commonrail.plugins.update.study import LOCAL, Addition, make_updated_study, read_addition
from commonrail.readers.toml import read_toml
from commonrail.report.data.bands import too_few_inside
from commonrail.report.data.view import view_of
from commonrail.report.page import write_report
from commonrail.runs.fingerprint import check_origins
from commonrail.runs.fit import Listener, calibrate_into
from commonrail.runs.folder import DRAWS, RESULT, STUDY, new_folder, read_draws, read_record, read_result, write_record
from commonrail.runs.journal import JOURNAL, read_about, read_inputs

FAR_LEVEL = 0.999  # level of the bands that decide on a contradiction
# A data set contradicts the run if at least this share of its values, and at least this number, lie outside the far
# bands. If the bands are right, the probability of that is at most 1 %, however the values depend on each other
# (Markov's inequality: 0.001/0.1).
FAR_SHARE, FAR_LEAST = 0.1, 2
RISEN = 0.01  # smallest relative rise of an error that is reported


@dataclass(frozen=True, repr=False)
class Update(Shown):
    """Result of an update.

    Attributes
    ----------
    folder : Path
        New run folder.
    calibration : Calibration
        Fit of old and new data.
    agreements : dict of str to Agreement
        By new data set.
    content : dict
        JSON-able record, update.json of the folder.
    """

    presenter = "commonrail.plugins.update.page:UPDATE"

    folder: Path
    calibration: Calibration
    agreements: dict[str, Agreement]
    content: dict[str, Any]


def update(
    run: str | Path,
    files: Sequence[str | Path] = (),
    *,
    out: str | Path,
    held_out: Sequence[str | Path] = (),
    stated: StatedByUser | None = None,
    global_search: bool = False,
    as_begun: bool = False,
    threads: int | None = None,
    listener: Listener | None = None,
) -> Update:
    """Judge new data by the prediction bands of a run, then fit old and new data together into a new run folder.

    Parameters
    ----------
    run : str or Path
        Folder of a finished calibration, which is not changed.
    files, held_out : sequence of str or Path
        New data files to fit, and files for comparison only; read as by `commonrail new --from`.
    out : str or Path
        New run folder. It appears when complete; an error or Ctrl-C leaves nothing.
    stated : StatedByUser, optional
        Pressures, units and forms that are missing from the files.
    global_search : bool
        Search with the optimiser of the study; default: least squares from the calibrated values.
    as_begun : bool
        Use the copies in `run` although the original files have changed.
    threads, listener : optional
        As for `calibrate_into`.

    Raises
    ------
    InputError
        If the run is missing, a file cannot be read or is in the study already, or `out` is not empty.
    StudyError
        If the run is unfinished, or its study has changed.
    ConfigurationError
        If an argument has the wrong type, or no file is named.

    Notes
    -----
    If fitted data of the run are missing, its draws give the prior of each parameter: a normal distribution about the
    calibrated value, without correlations.
    """
    folder, place = file_path(run, "run"), file_path(out, "out")
    fitted_files = [file_path(path, "files") for path in sequence(files, "files", '["new.csv"]')]
    held_out_files = [file_path(path, "held_out") for path in sequence(held_out, "held_out", '["new.csv"]')]
    if not fitted_files and not held_out_files:
        raise ConfigurationError("files: name one or more files with new data.")
    stated, threads = instance(stated or StatedByUser({}), StatedByUser, "stated"), thread_count(threads)
    listener = instance(listener or Listener(), Listener, "listener")
    fit = read_as(CalibrationRecord, read_result(folder), folder / RESULT)
    inputs = read_inputs(folder) if (folder / JOURNAL).is_file() else []
    if fit.status != "finished":
        again = f"`{command('resume', folder)}`"
        raise StudyError(f"{folder}: the search of this run was stopped before its end; {again} runs it to its end.")
    if inputs and not flag(as_begun, "as_begun"):
        cure = "add --as-begun to update it as it was"
        check_origins(folder, inputs, str(read_about(folder).get("given", "")), cure)
    best = {parameter.name: parameter.best for parameter in fit.parameters}
    draws = read_draws(folder, list(best)) if (folder / DRAWS).is_file() else None
    document = read_toml(folder / STUDY)[0]
    gone = [block["name"] for block in document["data"] if not (folder / block["file"]).is_file()]
    fitted = [block["name"] for block in document["data"] if block["role"] == "fit"]
    is_prior = any(name in gone for name in fitted)
    if is_prior and draws is None:
        raise InputError(f"{folder}: the fitted data ({gone[0]}) and the draws are missing; restore the data.")
    former = folder / RECORD
    optimiser = document.get("optimiser", {})
    if former.is_file():  # stated by the user, before any update
        optimiser = read_as(UpdateRecord, read_record(former, "commonrail update"), former).optimiser
    with new_folder(place) as unfinished:
        addition = read_addition(folder, inputs, fitted_files, held_out_files, stated)
        study = make_updated_study(
            folder,
            fit.parameters,
            addition,
            [*gone, *fitted] if is_prior else gone,
            draws if is_prior else None,
            optimiser if flag(global_search, "global_search") else LOCAL,
        )
        listener.note("judging the new data by the prediction bands of the run ...")
        new = _judge_new_data(study, addition, best, None if is_prior else draws, threads)
        calibration = calibrate_into(unfinished, study, threads=threads, listener=listener)
        if calibration.status != "finished":
            raise KeyboardInterrupt
        result = UpdateRecord(
            run=str(folder),
            optimiser=optimiser,
            gone=tuple(gone),
            prior=is_prior,
            new=new,
            moved=_compare_values(fit, calibration),
            errors=_errors(calibration),
        )
        content = to_record(result._asdict() | {"lines": update_lines(result)})
        with write_set(unfinished):
            write_record(unfinished / RECORD, content)
        write_report(unfinished, live=False)
    return Update(place, calibration, {data.name: data.agreement for data in new}, content)


def _judge_new_data(
    study: Study, addition: Addition, best: Mapping[str, float], draws: Floats | None, threads: int | None
) -> tuple[NewData, ...]:
    """Compare new data sets with the earlier run, whose calibrated values are the start values of the study."""
    fitted = [data for data in of_role(study.data, Role.FIT) if not addition.holds(data.name)]
    new, bands = [data for data in study.data if addition.holds(data.name)], dict[str, Band]()
    unseen = [data.changed(role=Role.VALIDATION) for data in new if data.kind in {other.kind for other in fitted}]
    if draws is not None and unseen:
        with suppress(SimulationError):  # the fit that follows reports it
            predicted_study = replace(study, data=(*fitted, *unseen))
            prediction = predict(predicted_study, best, draws=draws, levels=(LEVEL, FAR_LEVEL), threads=threads)
            bands = {band.data.name: band for band in prediction.bands}
    scores = score_all(study, study.injector, threads, new)
    rows = (
        NewData(data.name, data.role, _measure_error(data, score), _baseline(data, score, fitted), Agreement.UNJUDGED)
        for data, score in zip(new, scores, strict=True)
    )
    return tuple(_judge_by_band(row, bands.get(row.name)) for row in rows)


def _judge_by_band(row: NewData, band: Band | None) -> NewData:
    values = 0 if band is None else int(np.count_nonzero(band.counted))
    if band is None or not values:
        return row
    outside, agreement = values - band.covered(FAR_LEVEL), Agreement.AGREES
    if outside >= max(FAR_SHARE * values, min(FAR_LEAST, values)):
        agreement = Agreement.CONTRADICTS
    elif too_few_inside({"band": band.judgement(LEVEL, "")}):
        agreement = Agreement.OUTSIDE
    return row._replace(agreement=agreement, values=values, covered=band.covered(LEVEL), far=outside)


def _measure_error(data: DataSet, score: Score) -> ErrorSize:
    """Error of a data set as in the verdict of a report."""
    fit_error = view_of(data.kind).fit_error(data.record({JUDGED: score}))
    size = fit_error.size if fit_error else float(np.sqrt(np.mean(data.errors(score.values) ** 2)))
    return ErrorSize(number(size), fit_error is None or fit_error.in_tolerances)


def _baseline(data: DataSet, score: Score, fitted: Sequence[DataSet]) -> Baseline | None:
    """Trivial model from the fitted data: the usual one of the kind, or for a curve the fitted curve nearest to it."""
    for item in score.baselines(fitted):
        return Baseline(str(item["text"]), item.get("beaten"))
    curves = [item for item in fitted if isinstance(item, RateData)]
    if not isinstance(data, RateData) or not curves:
        return None
    place = _place(data)
    nearest = min(curves, key=lambda item: float(np.abs(np.log(_place(item) / place)).sum()))
    volume = np.append(0.0, np.cumsum(nearest.rate * np.diff(nearest.bounds)))
    trivial = replace(score, values=np.diff(np.interp(data.bounds, nearest.bounds, volume)) / np.diff(data.bounds))
    size, other = (_measure_error(data, item).size for item in (score, trivial))
    beaten = None if size is None or other is None else size < other
    return Baseline(f"the nearest fitted curve, {nearest.name}", beaten)


def _place(data: RateData) -> Floats:
    return np.array([data.point.initial_pressures()[0], 1e-6 + sum(pulse.duration for pulse in data.point.pulses)])


def _compare_values(fit: CalibrationRecord, calibration: Calibration) -> tuple[MovedParameter, ...]:
    """Values [SI] before and after; largest move first, in half widths of the earlier interval."""
    intervals = {p.name: (p.lower, p.upper) for p in fit.certainty.parameters} if fit.certainty else {}
    rows = []
    for parameter in fit.parameters:
        after = calibration.best[parameter.name]
        low, high = intervals.get(parameter.name, (None, None))
        moved = None if low is None or high is None or low == high else 2.0 * (after - parameter.best) / (high - low)
        rows.append(MovedParameter(parameter.name, parameter.unit, parameter.best, after, moved))
    return tuple(sorted(rows, key=lambda row: -abs(row.moved or 0.0)))


def _errors(calibration: Calibration) -> tuple[ChangedError, ...]:
    """Error of each data set with the earlier and the new values; it rises by more than `RISEN`."""
    rows, scores = [], calibration.scores
    for data, start, best in zip(calibration.study.data, scores["start"], scores[JUDGED], strict=True):
        before, after = _measure_error(data, start), _measure_error(data, best)
        rises = after.size is None or (before.size is not None and after.size > (1.0 + RISEN) * before.size)
        rows.append(ChangedError(data.name, data.role, before, after, rises))
    return tuple(rows)
