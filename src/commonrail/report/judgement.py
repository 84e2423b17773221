"""Judgement of a fit: bands, effective parameters, combinations, other seeds, rows that were held out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from commonrail.display.table import Part, Table, table_of
from commonrail.display.text import MISSING, fixed, listed, number, signed, significant
from commonrail.kinds import KINDS, DataSet
from commonrail.kinds.bands import band_sentence
from commonrail.kinds.records import LABELS, MEAN, MICROSECOND, MM3, Record
from commonrail.report.record import of_role

__all__ = ["combination_table", "judgement_lines", "judgement_tables"]

_WORDS = {"rail_pressure": "rail pressure", "energising_time": "energising time"}


def judgement_lines(record: Record) -> list[str]:
    """Sentences on bands, effective parameters, spread of seeds and predictions of what was held out."""
    lines = [band_sentence(d) for d in record["data"] if "band" in d]
    known = (record.get("certainty") or {}).get("parameters", [])
    if known and not lines and all(None in (one["lower"], one["upper"]) for one in known):
        lines.append("There are no bands: no parameter has an interval, so nothing bounds what the model predicts.")
    if found := record.get("identifiability"):
        lines.append(_effective(found, len(record["parameters"]), _unit(record)))
    refits = record.get("refits", {})
    lines += _seed_lines(refits.get("seeds", ()))
    lines += [line for one in refits.get("left_out", ()) for line in _left_out_lines(one)]
    if refits.get("interrupted"):
        lines.append("The user stopped the further searches: those that are missing were not run.")
    return lines


def judgement_tables(record: Record) -> list[Table]:
    """Tables of other seeds and of rows that were held out, where there are any."""
    refits = record.get("refits", {})
    tables = [_seed_table(refits["seeds"])] if refits.get("seeds") else []
    return tables + ([_left_out_table(refits["left_out"])] if refits.get("left_out") else [])


def combination_table(record: Record) -> Table | None:
    """Combinations of parameters that the data hold, by falling singular value; None in a record without them."""
    found = record.get("identifiability")
    if not found:
        return None
    least = 1.0 if _unit(record) == DataSet.residual_unit else 0.0  # a tolerance is no smaller than it is stated
    scatter = max(float(found["scatter"]), least)
    held = [c for c in found["combinations"] if c["singular_value"] > scatter]
    rest = len(record["parameters"]) - len(held)
    parts = (
        Part(("combination",), lambda c: (_weights(c["weights"]),)),
        Part(("singular value",), lambda c: (significant(c["singular_value"], 3),)),
        Part(("standard error, % of the bounds",), lambda c: (significant(100.0 * scatter / c["singular_value"], 2),)),
    )
    note = (
        "Moves of parameters, each in widths of its bounds, that change the fitted data, and their standard error by "
        f"the data alone; parameters with a weight below 0.2 are not named. {rest} further combinations are not known "
        "to within the width of the bounds: priors and bounds alone hold them."
    )
    return table_of("Combinations that the data hold", held, parts, note, 1)


def _weights(weights: Mapping[str, Any]) -> str:
    texts = [f"{signed(weight, 2)} {name}" for name, weight in weights.items()]
    return ", ".join(texts) or "many parameters, none with 0.2"


def _unit(record: Record) -> str:
    """Unit of the scatter of the fitted residuals, which are weighted where data of several units are fitted."""
    units = {KINDS[d["kind"]].residual_unit for d in of_role(record["data"], "fit")}
    return units.pop() if len(units) == 1 else "of their weighted units"


def _effective(found: Record, parameters: int, unit: str) -> str:
    return (
        f"{found['residuals']} residuals determine {fixed(found['effective_parameters'], 1)} effective parameters of "
        f"{parameters}; their scatter about the fit is {significant(found['scatter'], 3)} {unit}."
    )


def _seed_lines(seeds: Sequence[Record]) -> list[str]:
    done = [seed for seed in seeds if not seed.get("failed")]
    if len(done) < 2:
        return []
    names = done[0]["positions"]
    spread = {name: _range(seed["positions"][name] for seed in done) for name in names}
    widest = max(spread, key=lambda name: spread[name])
    if spread[widest] < 1e-3:
        return [f"{len(done)} seeds end at the same values, within 0.1 % of the bounds."]
    ends = listed([significant(seed["objective"], 4) for seed in done])
    return [
        f"{len(done)} seeds end at objectives of {ends}; the parameter that differs most between them is {widest}, by "
        f"{fixed(100.0 * spread[widest], 0)} % of its bounds."
    ]


def _range(values: Any) -> float:
    found = list(values)
    return float(max(found) - min(found))


def _seed_table(seeds: Sequence[Record]) -> Table:
    heads = seeds[0]["errors"]
    parts = (
        Part(("seed", "objective"), lambda seed: (str(seed["seed"]), significant(seed.get("objective")))),
        Part(
            [f"{name}: {seeds[0]['error_heads'][name]}" for name in heads],
            lambda seed: [significant(seed.get("errors", {}).get(name), 3) for name in heads],
        ),
    )
    note = "The first seed is that of the result. The spread is that of the search, not that of the parameters."
    return table_of("Other seeds", seeds, parts, note, 1)


def _left_out_lines(one: Record) -> list[str]:
    by = _WORDS.get(one["by"], one["by"])
    lines = [
        f"Each {by} of {one['name']} held out in turn, {one['searches']} searches, and predicted: "
        f"{_metrics(one['figures'])}."
    ]
    if "mean" in one:
        lines.append(f"The mean of the members of each search gives {_metrics(one['mean'])}.")
    if one["failed"]:
        lines.append(f"The search without {listed(one['failed'])} could simulate no candidate.")
    for baseline in one["baselines"]:
        beyond = baseline.get("extrapolated")
        said = f", {beyond} of its {one['values']} values extrapolated" if beyond else ""
        beats = "beats" if baseline["beaten"] else "does not beat"
        lines.append(f"There the model {beats} {baseline['text']}, which gives {_metrics(baseline['figures'])}{said}.")
    return lines


def _metrics(figures: Record) -> str:
    limit = significant(figures["limit_quantity"], 3, MM3)
    parts = [
        f"{fixed(figures[key], decimals, scale)} {unit} rms {words}"
        for key, decimals, scale, unit, words in (
            ("rms_large_percent", 2, 1.0, "%", f"above {limit} mm³"),
            ("rms_small", 3, MM3, "mm³", f"up to {limit} mm³"),
        )
        if number(figures.get(key)) is not None
    ]
    return " and ".join(parts) or MISSING


def _left_out_table(found: Sequence[Record]) -> Table:
    rows: list[tuple[Record, str, Record]] = []
    for one in found:
        rows.append((one, "model", one["figures"]))
        if "mean" in one:
            rows.append((one, LABELS[MEAN], one["mean"]))
        rows += [(one, baseline["text"], baseline["figures"]) for baseline in one["baselines"]]
    limit = significant(found[0]["figures"]["limit_quantity"], 3, MM3)
    parts = (
        Part(
            ("data set", "held out in turn", "predicted by"),
            lambda r: (r[0]["name"], _WORDS.get(r[0]["by"], r[0]["by"]), r[1]),
        ),
        Part(("searches", "quantities"), lambda r: (str(r[0]["searches"]), str(r[0]["values"]))),
        Part(
            (f"above {limit} mm³, % rms", f"up to {limit} mm³, mm³ rms", "dead time, µs rms"),
            lambda r: (
                fixed(r[2].get("rms_large_percent"), 2),
                fixed(r[2].get("rms_small"), 3, MM3),
                fixed(r[2].get("dead_time_rms"), 1, MICROSECOND),
            ),
        ),
    )
    note = "Every row is predicted by a fit that did not see the rows at its value; outermost values are extrapolated."
    return table_of("Predictions of what was held out", rows, parts, note, 3)
