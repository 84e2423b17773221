"""Result of a calibration in sentences."""

from __future__ import annotations

from collections.abc import Sequence

from commonrail.display.text import fixed, listed, number, significant
from commonrail.kinds.records import Record
from commonrail.report.meters import meter_lines
from commonrail.report.record import by_kind, of_role

__all__ = [
    "baseline_lines",
    "convergence_lines",
    "data_lines",
    "headline",
    "parameter_lines",
    "synthetic_notes",
    "warning_lines",
]

_ENDINGS = {
    None: "the search ran to its end",
    True: "the search has converged",
    False: "the search ran to its end and has not converged",
}
NAMED = 6  # data sets that a sentence names
_ROLES = {"fit": "On the fitted data", "validation": "On data that the fit never saw"}


def headline(record: Record) -> list[str]:
    """Sentences on what was calibrated, how far the objective fell, and how well each role is met."""
    return [
        _task(record),
        _objective(record),
        *convergence_lines(record),
        *data_lines(record["data"]),
        *baseline_lines(record["data"]),
        *meter_lines(record),
    ]


def data_lines(data: Sequence[Record]) -> list[str]:
    """One sentence or more for each kind and role of data."""
    return [
        f"{opening}{end}."
        for role, opening in _ROLES.items()
        for view, own in by_kind(of_role(data, role))
        for end in view.sentences(own)
    ]


def baseline_lines(data: Sequence[Record]) -> list[str]:
    """One sentence for each trivial model beside data of validation: whether the calibrated model beats it."""
    return [str(baseline["sentence"]) for d in data for baseline in d.get("baselines", ())]


def convergence_lines(record: Record) -> list[str]:
    """Sentence on whether the search has converged, with the rule; none of a record that does not say."""
    found = record.get("convergence")
    return [f"Search {found['sentence']}."] if found else []


def parameter_lines(parameters: Sequence[Record]) -> list[str]:
    """Sentences on what the data say of the parameters, and on those that ended at a bound."""
    lines = []
    for verdict in dict.fromkeys(p["verdict"] for p in parameters if p.get("verdict")):
        names = [p["name"] for p in parameters if p.get("verdict") == verdict]
        if names:
            lines.append(f"{verdict.capitalize()}: {listed(names)}.")
    bounded = [p["name"] for p in parameters if p.get("at_bound")]
    if bounded:
        lines.append(
            f"At a bound: {listed(bounded)}. The best value may lie outside; widen the bound if the "
            "part allows it, otherwise read it as something the model lacks."
        )
    return lines


def synthetic_notes(record: Record) -> list[str]:
    """Notes on synthetic data: the whole record's note, then what only a data set says, then their names."""
    texts = [record.get("synthetic", "")]
    chosen = [d for d in record["data"] if d.get("synthetic")]
    texts += [d["synthetic"] for d in chosen if d["synthetic"] not in texts[0]]
    if chosen:
        texts.append(f"Synthetic data: {listed([d['name'] for d in chosen])}.")
    return [text for text in texts if text]


def warning_lines(record: Record) -> list[str]:
    """Sentences of the warnings."""
    return [str(warning["sentence"]) for warning in record["warnings"]]


def _task(record: Record) -> str:
    injector, data = record["injector"], record["data"]
    fit = [d["name"] for d in of_role(data, "fit")]
    sets = f"{len(fit)} data set{'s' if len(fit) != 1 else ''}"
    sets += f" ({listed(fit)})" if 0 < len(fit) <= NAMED else ""
    name = injector.get("title") or injector["name"]
    count = len(record["parameters"])
    task = f"{count} parameter{'s' if count != 1 else ''} of “{name}” ({injector['variant']})"
    if record["status"] == "interrupted":
        ending = "the search was stopped early and these are the best values up to then"
    else:
        ending = _ENDINGS[record.get("convergence", {}).get("converged")]
    return f"{task} fitted to {sets}; {ending}."


def _objective(record: Record) -> str:
    start, best = (number(record["objective"].get(key)) for key in ("start", "best"))
    if best is None:
        return "No candidate could be simulated."
    if start is None:
        return f"The objective ended at {significant(best)}; the start values fail to simulate."
    share = f" ({fixed(100.0 * (best / start - 1.0), 0)} %)".replace("-", "−") if start else ""
    if best < start:
        return f"The objective fell from {significant(start)} to {significant(best)}{share}."
    return f"The objective did not fall: {significant(start)} at the start and still at the end."
