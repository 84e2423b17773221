"""First page of a calibration's report: may the result be used, why, and what to do next."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from commonrail.display.text import listed, number
from commonrail.files.run_folder import LIKELY
from commonrail.kinds import KINDS
from commonrail.kinds.bands import too_few_inside
from commonrail.kinds.records import JUDGED, Record
from commonrail.report.certainty import difference
from commonrail.report.record import of_role
from commonrail.report.rerun import map_line

__all__ = ["Step", "ReportVerdict", "verdict"]

GOOD, CARE, BAD = "good", "care", "bad"
SHOWN = 4  # parameters that a sentence names


class Step(NamedTuple):
    """One thing to do, and the command line for it if there is one."""

    text: str
    command: str = ""


class ReportVerdict(NamedTuple):
    """Verdict on a calibration.

    Attributes
    ----------
    level : str
        "good", "care" or "bad".
    title : str
        In a few words.
    reasons : list of str
        What speaks against the result; what speaks for it where there is nothing.
    steps : list of Step
        What to do next, the most urgent first.
    """

    level: str
    title: str
    reasons: list[str]
    steps: list[Step]


class _Point(NamedTuple):
    """Something that speaks against a result, how much, and its cure."""

    level: str
    reason: str
    step: Step


_TITLES = {
    GOOD: "Nothing found against using this result",
    CARE: "Usable with care",
    BAD: "Not usable yet",
}


def verdict(record: Record, run: str) -> ReportVerdict:
    """Verdict on a calibration by its record; `run` is the folder's name for the command lines."""
    folder = shlex.quote(run)
    found = [
        *_better(record, folder),
        *_ending(record, folder),
        *_plausibility(record, folder),
        *_prediction(record),
        *_parameters(record, folder),
    ]
    levels = {point.level for point in found}
    level = BAD if BAD in levels else CARE if CARE in levels else GOOD
    found.sort(key=lambda point: point.level != BAD)
    steps = list(dict.fromkeys(point.step for point in found))
    return ReportVerdict(
        level,
        _TITLES[level],
        [point.reason for point in found] or _praise(record),
        steps if level == BAD else [*steps, Step(*map_line(record, run))],
    )


def _better(record: Record, folder: str) -> Iterator[_Point]:
    """Most likely values that fit better than the calibrated ones by more than noise explains."""
    found = difference(record)
    if found is None or not found.matters:
        return
    if record["certainty"]["starts"] > 1:
        text = "Compare both fits on all data, and take most-likely.toml as the injector if it is the better one."
        command = f"commonrail compare {folder} likely={folder}/{LIKELY} --data {folder}/study.toml"
    else:
        text, command = _full(folder)
    yield _Point(CARE, found.sentence, Step(text, command))


def _full(folder: str) -> Step:
    text = "Compute full intervals of the parameters, and search for their most likely values from several starts."
    return Step(text, f"commonrail certainty {folder}")


def _ending(record: Record, folder: str) -> Iterator[_Point]:
    """Search that failed, was stopped or has not converged."""
    best, start = (number(record["objective"].get(key)) for key in ("best", "start"))
    if best is None:
        step = Step("Correct the injector or the operating points until the start values can be simulated.")
        yield _Point(BAD, "No candidate could be simulated.", step)
        return
    if record["status"] == "interrupted":
        step = Step("Run the search to its end.", f"commonrail resume {folder}")
        yield _Point(BAD, "The search was stopped before its end.", step)
    elif record.get("convergence", {}).get("converged") is False:
        sentence = str(record["convergence"]["sentence"]).removeprefix("not converged: ")
        step = Step("Continue the search.", f"commonrail resume {folder} --generations 50")
        yield _Point(CARE, f"The search has not converged: {sentence}.", step)
    if start is not None and not best < start:
        step = Step("Check bounds and data: the start values fit as well as anything that was tried.")
        yield _Point(BAD, "The objective did not fall below that of the start values.", step)


def _plausibility(record: Record, folder: str) -> Iterator[_Point]:
    if count := len(record["warnings"]):
        reason = f"{count} implausible finding{'s' if count > 1 else ''}, named at the top of this page."
        step = Step(
            "Check the findings at the top of this page against the test bench, correct the study, calibrate again."
        )
        yield _Point(BAD, reason, step._replace(command=f"commonrail calibrate {folder}/study.toml"))
    if synthetic := [d["name"] for d in record["data"] if d.get("synthetic")]:
        reason = f"{_some(synthetic)} {'are' if len(synthetic) > 1 else 'is'} synthetic, not measured."
        yield _Point(
            CARE, reason, Step("Replace synthetic data by measured ones before the result is used on an engine.")
        )


def _prediction(record: Record) -> Iterator[_Point]:
    """Data that the fit has not seen: none, or met worse than a trivial model meets them."""
    validation, held_out = of_role(record["data"], "validation"), record.get("refits", {}).get("left_out", ())
    if not validation and not held_out:
        step = Step('Set role = "validation" for one data set of study.toml, or measure another one.')
        yield _Point(CARE, "No data were held back: errors on unseen points are not known.", step)
    if lost := [d["name"] for d in validation if _is_lost(d)]:
        cure = Step("Correct these operating points, or narrow the bounds until the calibrated model runs there.")
        yield _Point(CARE, f"The calibrated model does not run at all points of {_some(lost)}.", cure)
    step = Step("Free fewer parameters or add data between the fitted ones; see “Figures of merit”.")
    if narrow := [d["name"] for d in record["data"] if "band" in d and too_few_inside(d)]:
        cure = Step(
            "State a discrepancy of these data, or free what the model lacks; do not rely on its bands until then."
        )
        yield _Point(CARE, f"The bands hold too few measured values of {_some(narrow)}: they are too narrow.", cure)
    if worse := _beaten(validation):
        yield _Point(CARE, f"On {_some(worse)} a trivial model is as good or better.", step)
    if worse := _beaten(held_out):
        yield _Point(CARE, f"On held out rows of {_some(worse)} a trivial model is as good or better.", step)


def _is_lost(data: Record) -> bool:
    """True if the calibrated model has no number for the data, or for a row that is no dead time."""
    if "rows" not in data:
        return "J" in data and number(data["J"].get(JUDGED)) is None
    return any(number(row.get(JUDGED)) is None for row in data["rows"] if not row.get("dead_time"))


def _beaten(records: Iterable[Record]) -> list[str]:
    """Names of those on which a baseline is as good as the model."""
    found = [one["name"] for one in records if any(b.get("beaten") is False for b in one.get("baselines", ()))]
    return list(dict.fromkeys(found))


def _parameters(record: Record, folder: str) -> Iterator[_Point]:
    parameters = record["parameters"]
    if bounded := [p["name"] for p in parameters if p.get("at_bound")]:
        step = Step("Widen the bounds of these parameters in study.toml if the parts allow it, and calibrate again.")
        yield _Point(CARE, f"At a bound: {_some(bounded)}.", step)
    loose = [p["name"] for p in parameters if p.get("verdict") and p["verdict"] != "pinned"]
    if loose:
        reason = f"The data do not pin down {len(loose)} of {len(parameters)} parameters: {_some(loose)}."
        profiled = record.get("certainty", {}).get("starts", 1) > 1
        yield _Point(CARE, reason, _plan(record, folder) if profiled else _full(folder))


def _plan(record: Record, folder: str) -> Step:
    """Measurements to plan; of data at one operating point `next` needs the range of the bench."""
    text = "Plan the measurements that would pin them down"
    points = [p for d in of_role(record["data"], "fit") for p in KINDS[d["kind"]].view.operating_points(d)]
    if len({(p.get("rail_pressure"), p.get("energising_time")) for p in points}) == 1:
        return Step(
            f"{text} with commonrail next. The fitted data are of one operating point: state what the bench can run by "
            "--rail-pressure and --energising-time."
        )
    return Step(f"{text}.", f"commonrail next {folder} --points 3 --out plan.csv")


def _praise(record: Record) -> list[str]:
    lines = ["The search has converged."] if record.get("convergence", {}).get("converged") else []
    lines.append("No finding is implausible and no parameter is at a bound.")
    if of_role(record["data"], "validation"):
        lines.append("Data were held back, and the calibrated model was judged on them.")
    return lines


def _some(names: list[str]) -> str:
    """Names, the first few of many."""
    if len(names) <= SHOWN + 1:
        return listed(names)
    return f"{', '.join(names[:SHOWN])} and {len(names) - SHOWN} more"
