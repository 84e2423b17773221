"""Content that notebooks show of judgements of a fit: certainty, predictions, posterior and measuring plan."""

from __future__ import annotations

from collections import Counter

from commonrail.analysis.certainty.certify import Certainty
from commonrail.analysis.certainty.record import certainty_record
from commonrail.analysis.certainty.verdict import ParameterVerdict
from commonrail.analysis.design.next import Plan
from commonrail.analysis.posterior.record import posterior_record
from commonrail.analysis.posterior.sample import Posterior
from commonrail.analysis.prediction.predict import Prediction
from commonrail.display.table import Table
from commonrail.display.text import counted, fixed, significant
from commonrail.kinds.records import Record
from commonrail.report.certainty import certainty_lines, certainty_tables, posterior_table
from commonrail.report.prediction import coverage_table, points_table

__all__ = [
    "certainty_face_lines",
    "certainty_face_tables",
    "plan_line",
    "posterior_lines",
    "posterior_tables",
    "prediction_lines",
    "prediction_tables",
]


def certainty_face_lines(found: Certainty) -> list[str]:
    """Number of parameters by verdict, then the sentences of the report."""
    counts = Counter(judged.verdict for judged in found.verdicts)
    size = counted(len(found.verdicts), "parameter")
    named = [f"{counts[verdict]} {verdict.value}" for verdict in ParameterVerdict if counts[verdict]]
    return [f"{size}: {', '.join(named)}", *certainty_lines(_kept(found))]


def certainty_face_tables(found: Certainty) -> list[Table]:
    """Tables of the report."""
    return certainty_tables(_kept(found))


def _kept(found: Certainty) -> Record:
    """Record as result.json keeps it, with the units of the parameters."""
    own = found.estimate.likelihood
    parameters = [{"name": name, "unit": unit} for name, unit in zip(own.names, own.units, strict=True)]
    return {"parameters": parameters, "certainty": certainty_record(found)}


def prediction_lines(found: Prediction) -> list[str]:
    """Number of predicted values and measured ones inside, and the estimator."""
    levels = " and ".join(fixed(level, 0, 100.0) for level in found.levels)
    sets = [f"{counted(len(band.values), 'value')} of {band.data.name}" for band in found.bands[:4]]
    more = ", …" if len(found.bands) > 4 else ""
    return [f"{', '.join(sets)}{more} with bands of {levels} %", f"Bands: {found.estimator}."]


def prediction_tables(found: Prediction) -> list[Table]:
    """Predicted quantities of operating points, or how many measured values the bands hold."""
    record = found.record()
    return [coverage_table(record) if any(band.measured for band in found.bands) else points_table(record)]


def posterior_lines(found: Posterior) -> list[str]:
    """Number of draws and agreement of the chains."""
    chains, steps, size = found.unit.shape
    state = f"refused: {found.refusal}" if found.refusal else "chains agree"
    worst, fewest = significant(float(found.r_hat.max()), 4), fixed(float(found.effective.min()), 0)
    return [
        f"{chains * steps} draws of {counted(size, 'parameter')}; {state}; largest R-hat {worst}, at least {fewest} "
        "effective draws"
    ]


def posterior_tables(found: Posterior) -> list[Table]:
    """Table of the report: medians and intervals, R-hat, effective draws."""
    units = dict(zip(found.names, found.estimate.likelihood.units, strict=True))
    return [posterior_table(posterior_record(found), units)]


def plan_line(found: Plan) -> str:
    """Number of measurements, cost and gain."""
    gain = f"; standard deviation times {fixed(found.measurements[-1].factor, 3)}" if found.measurements else ""
    return f"{counted(len(found.measurements), 'measurement')} at cost {found.cost:g}{gain}"
