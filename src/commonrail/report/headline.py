"""What a calibration achieved, in sentences."""

from __future__ import annotations

from collections.abc import Sequence

from commonrail.report.record import Record, number, of_kind, of_role
from commonrail.report.text import fixed, listed, significant

__all__ = ["data_lines", "headline", "parameter_lines", "synthetic_notes", "warning_lines"]

MM3 = 1e9  # of 1 m³
_ROLES = {"fit": "On the fitted data", "validation": "On data that the fit never saw"}


def headline(record: Record) -> list[str]:
    """Sentences on what was calibrated, how far the objective fell, and how well each role is met."""
    return [_task(record), _objective(record), *data_lines(record["data"])]


def data_lines(data: Sequence[Record]) -> list[str]:
    """One sentence for each kind and role of data."""
    lines = []
    for role, opening in _ROLES.items():
        chosen = of_role(data, role)
        if curves := of_kind(chosen, "rate"):
            lines.append(f"{opening}, {_curves(curves)}.")
        lines += [f"{opening} ({d['name']}), {_map(d)}." for d in of_kind(chosen, "quantities")]
    return lines


def parameter_lines(parameters: Sequence[Record]) -> list[str]:
    """Sentences on which parameters the data pin down, and which ended at a bound."""
    lines = []
    for verdict in ("pinned down", "pinned only in combination", "hardly moved by the data"):
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
    """What is synthetic: the whole record's note, then what only a data set says, then their names."""
    texts = [record.get("synthetic", "")]
    chosen = [d for d in record["data"] if d.get("synthetic")]
    texts += [d["synthetic"] for d in chosen if d["synthetic"] not in texts[0]]
    if chosen:
        texts.append(f"Synthetic data: {listed([d['name'] for d in chosen])}.")
    return [text for text in texts if text]


def warning_lines(record: Record) -> list[str]:
    """Sentences of the warnings; records of early versions have none."""
    return [str(warning["sentence"]) for warning in record.get("warnings", [])]


def _task(record: Record) -> str:
    injector, data = record["injector"], record["data"]
    fit = [d["name"] for d in of_role(data, "fit")]
    sets = f"{len(fit)} data set{'s' if len(fit) != 1 else ''}"
    name = injector.get("title") or injector["name"]
    count = len(record["parameters"])
    task = f"{count} parameter{'s' if count != 1 else ''} of “{name}” ({injector['variant']})"
    if record["status"] == "interrupted":
        ending = "the search was stopped early and these are the best values up to then"
    else:
        ending = "the search ran to its end"
    return f"{task} fitted to {sets} ({listed(fit)}); {ending}."


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


def _curves(curves: Sequence[Record]) -> str:
    found = []
    for d in curves:
        best = fixed(d["J"].get("best"), 1)
        others = [
            f"{fixed(d['J'][key], 1)} {words}"
            for key, words in (("start", "with the start values"), ("rigid", "as a rigid body"))
            if number(d["J"].get(key)) is not None
        ]
        against = f" against {listed(others)}" if others else ""
        found.append(f"{d['name']} has J = {best} mm³/ms{against}")
    return listed(found)


def _map(data: Record) -> str:
    best, start = (data["figures"].get(key, {}) for key in ("best", "start"))
    limit = significant(best.get("limit_quantity"), 3, MM3)
    parts = []
    for key, scale, decimals, words in (
        ("rms_large_percent", 1.0, 1, f"quantities above {limit} mm³ are met to {{}} % rms"),
        ("rms_small", MM3, 2, f"those up to {limit} mm³ to {{}} mm³ rms"),
        ("dead_time_rms", 1e6, 0, "dead times to {} µs rms"),
    ):
        if number(best.get(key)) is None:
            continue
        text = words.format(fixed(best[key], decimals, scale))
        if number(start.get(key)) is not None:
            text += f" (start: {fixed(start[key], decimals, scale)})"
        parts.append(text)
    return listed(parts) or "nothing could be simulated"
