"""Update of a run: judge new data by its prediction bands, fit again with old and new data, say what has moved."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from commonrail.base.arguments import file_path, flag, instance, sequence, thread_count
from commonrail.base.arrays import Floats
from commonrail.base.display import Shown
from commonrail.base.errors import ConfigurationError, InputError, SimulationError, StudyError
from commonrail.base.output import write_set
from commonrail.base.text import command, number
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
from commonrail.plugins.update.page import RECORD, update_lines
from commonrail.plugins.update.study import LOCAL, Addition, read_addition, updated_study
from commonrail.readers.toml import read_toml
from commonrail.report.data.bands import too_few_inside
from commonrail.report.data.view import view_of
from commonrail.report.page import write_report
from commonrail.runs.fingerprint import check_origins
from commonrail.runs.fit import Listener, calibrate_into
from commonrail.runs.folder import DRAWS, STUDY, new_folder, read_draws, read_record, read_result, write_record
from commonrail.runs.journal import JOURNAL, read_about, read_inputs

FAR_LEVEL = 0.999  # of the bands that tell a contradiction
# Share of the values of a data set outside the far bands from which it contradicts the run, and their least number. If
# the bands are right, so many lie outside with a probability of at most 1 % however the values depend on each other
# (Markov's inequality: 0.001/0.1).
FAR_SHARE, FAR_LEAST = 0.1, 2
RISEN = 0.01  # relative rise of an error from which it is called one


class Agreement(StrEnum):
    """Agreement of new data with what a run predicts of them."""

    AGREES = "agrees"
    """The 90 % bands hold as many values as they should."""

    OUTSIDE = "outside the bands"
    """The 90 % bands hold too few values."""

    CONTRADICTS = "contradicts"
    """So many values lie outside the 99.9 % bands that old and new data can hardly be of one injector and one bench."""

    UNJUDGED = "not judged"
    """There are no bands: no data of this kind were fitted or are left, or the run has no draws."""


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
        Folder of a finished calibration; it is left as it is.
    files, held_out : sequence of str or Path
        New data files to fit and to compare only, read as `commonrail new --from` reads them.
    out : str or Path
        New run folder. It appears when all is done; an error or Ctrl-C leaves nothing.
    stated : StatedByUser, optional
        Pressures, units and forms that the files do not tell.
    global_search : bool
        Search with the optimiser of the study; by default least squares near the calibrated values.
    as_begun : bool
        Use the copies in `run` although the files outside have changed since.
    threads, listener : optional
        As for `calibrate_into`.

    Raises
    ------
    InputError
        If there is no such run, a file cannot be read or is in the study already, or `out` is not empty.
    StudyError
        If the run is unfinished, or its study has changed.
    ConfigurationError
        If an argument is of another kind, or no file is named.

    Notes
    -----
    Where fitted data of the run are gone, its draws become the prior of each parameter: a normal distribution about the
    calibrated value, without correlations.
    """
    folder, place = file_path(run, "run"), file_path(out, "out")
    fit = [file_path(path, "files") for path in sequence(files, "files", '["new.csv"]')]
    judge = [file_path(path, "held_out") for path in sequence(held_out, "held_out", '["new.csv"]')]
    if not fit and not judge:
        raise ConfigurationError("files: there are no new data; name one or more files.")
    stated, threads = instance(stated or StatedByUser({}), StatedByUser, "stated"), thread_count(threads)
    listener = instance(listener or Listener(), Listener, "listener")
    record, inputs = read_result(folder), read_inputs(folder) if (folder / JOURNAL).is_file() else []
    if record["status"] != "finished":
        again = f"`{command('resume', folder)}`"
        raise StudyError(f"{folder}: the search of this run was stopped before its end; {again} runs it to its end.")
    if inputs and not flag(as_begun, "as_begun"):
        cure = "add --as-begun to update it as it was"
        check_origins(folder, inputs, str(read_about(folder).get("given", "")), cure)
    best = {str(p["name"]): float(p["best"]) for p in record["parameters"]}
    draws = read_draws(folder, list(best)) if (folder / DRAWS).is_file() else None
    document = read_toml(folder / STUDY)[0]
    gone = [block["name"] for block in document["data"] if not (folder / block["file"]).is_file()]
    fitted = [block["name"] for block in document["data"] if block["role"] == "fit"]
    is_prior = any(name in gone for name in fitted)
    if is_prior and draws is None:
        raise InputError(f"{folder}: there are neither the fitted data ({gone[0]}) nor draws; bring the data back.")
    former = folder / RECORD
    optimiser = read_record(former, "commonrail update") if former.is_file() else document
    optimiser = optimiser.get("optimiser", {})  # of the user, before any update
    with new_folder(place) as unfinished:
        addition = read_addition(folder, inputs, fit, judge, stated)
        study = updated_study(
            folder,
            record["parameters"],
            addition,
            [*gone, *fitted] if is_prior else gone,
            draws if is_prior else None,
            optimiser if flag(global_search, "global_search") else LOCAL,
        )
        listener.note("judging the new data by the prediction bands of the run ...")
        new = _judged(study, addition, best, None if is_prior else draws, threads)
        calibration = calibrate_into(unfinished, study, threads=threads, listener=listener)
        if calibration.status != "finished":
            raise KeyboardInterrupt
        content: dict[str, Any] = {
            "run": str(folder),
            "optimiser": optimiser,
            "gone": gone,
            "prior": is_prior,
            "new": new,
        }
        content |= {"moved": _moved(record, calibration), "errors": _errors(calibration)}
        content["lines"] = update_lines(content)
        with write_set(unfinished):
            write_record(unfinished / RECORD, content)
        write_report(unfinished, live=False)
    return Update(place, calibration, {row["name"]: Agreement(row["agreement"]) for row in new}, content)


def _judged(
    study: Study, addition: Addition, best: Mapping[str, float], draws: Floats | None, threads: int | None
) -> list[dict[str, Any]]:
    """Records of new data sets, judged by a run whose calibrated values are the start values of the study."""
    fitted = [data for data in of_role(study.data, Role.FIT) if not addition.holds(data.name)]
    new, bands = [data for data in study.data if addition.holds(data.name)], dict[str, Band]()
    unseen = [data.changed(role=Role.VALIDATION) for data in new if data.kind in {other.kind for other in fitted}]
    if draws is not None and unseen:
        with suppress(SimulationError):  # the fit that follows says what cannot be simulated
            predicted_study = replace(study, data=(*fitted, *unseen))
            prediction = predict(predicted_study, best, draws=draws, levels=(LEVEL, FAR_LEVEL), threads=threads)
            bands = {band.data.name: band for band in prediction.bands}
    scores = score_all(study, study.injector, threads, new)
    return [
        {"name": data.name, "role": data.role.value, "error": _error_of(data, score)}
        | {"baseline": _baseline(data, score, fitted), **_agreement(bands.get(data.name))}
        for data, score in zip(new, scores, strict=True)
    ]


def _agreement(band: Band | None) -> dict[str, Any]:
    values = 0 if band is None else int(np.count_nonzero(band.counted))
    if band is None or not values:
        return {"agreement": Agreement.UNJUDGED.value}
    outside, agreement = values - band.covered(FAR_LEVEL), Agreement.AGREES
    if outside >= max(FAR_SHARE * values, min(FAR_LEAST, values)):
        agreement = Agreement.CONTRADICTS
    elif too_few_inside({"band": band.judgement(LEVEL, "")}):
        agreement = Agreement.OUTSIDE
    return {"agreement": agreement.value, "values": values, "covered": band.covered(LEVEL), "far": outside}


def _error_of(data: DataSet, score: Score) -> dict[str, Any]:
    """Error of a data set as the verdict of a report has it: a share, or in tolerances; JSON-able."""
    fit_error = view_of(data.kind).fit_error(data.record({JUDGED: score}))
    size = fit_error.size if fit_error else float(np.sqrt(np.mean(data.errors(score.values) ** 2)))
    return {"size": number(size), "in_tolerances": fit_error is None or fit_error.in_tolerances}


def _baseline(data: DataSet, score: Score, fitted: Sequence[DataSet]) -> dict[str, Any] | None:
    """Trivial model of the fitted data, that of the kind, or of a curve the fitted one at the nearest point."""
    for item in score.baselines(fitted):
        return {"text": str(item["text"]), "beaten": item.get("beaten")}
    curves = [item for item in fitted if isinstance(item, RateData)]
    if not isinstance(data, RateData) or not curves:
        return None
    place = _place(data)
    nearest = min(curves, key=lambda item: float(np.abs(np.log(_place(item) / place)).sum()))
    volume = np.append(0.0, np.cumsum(nearest.rate * np.diff(nearest.bounds)))
    trivial = replace(score, values=np.diff(np.interp(data.bounds, nearest.bounds, volume)) / np.diff(data.bounds))
    size, other = (_error_of(data, item)["size"] for item in (score, trivial))
    beaten = None if size is None or other is None else size < other
    return {"text": f"the nearest fitted curve, {nearest.name}", "beaten": beaten}


def _place(data: RateData) -> Floats:
    return np.array([data.point.initial_pressures()[0], 1e-6 + sum(pulse.duration for pulse in data.point.pulses)])


def _moved(record: Mapping[str, Any], calibration: Calibration) -> list[dict[str, Any]]:
    """Values [SI] before and after, largest move first in units of the half width of the earlier interval."""
    intervals = {parameter["name"]: parameter for parameter in record.get("certainty", {}).get("parameters", ())}
    rows = []
    for parameter in record["parameters"]:
        before, after = float(parameter["best"]), calibration.best[parameter["name"]]
        low, high = (intervals.get(parameter["name"], {}).get(end) for end in ("lower", "upper"))
        moved = None if low is None or high is None or low == high else 2.0 * (after - before) / (high - low)
        rows.append(
            {"name": parameter["name"], "unit": parameter["unit"], "before": before, "after": after, "moved": moved}
        )
    return sorted(rows, key=lambda row: -abs(row["moved"] or 0.0))


def _errors(calibration: Calibration) -> list[dict[str, Any]]:
    """Error of each data set with the earlier and the new values; it `rises` if by more than `RISEN`."""
    rows, scores = [], calibration.scores
    for data, start, best in zip(calibration.study.data, scores["start"], scores[JUDGED], strict=True):
        before, after = _error_of(data, start), _error_of(data, best)
        sizes = before["size"], after["size"]
        rises = sizes[1] is None or (sizes[0] is not None and sizes[1] > (1.0 + RISEN) * sizes[0])
        rows.append({"name": data.name, "role": data.role.value, "before": before, "after": after, "rises": rises})
    return rows
