"""Presenter of the certainty of a fit: what notebooks show of it."""

from __future__ import annotations

from collections import Counter

import numpy as np

from commonrail.base.chart import Figure
from commonrail.base.table import Table
from commonrail.base.text import count_noun
from commonrail.calibration.identifiability import ParameterVerdict
from commonrail.calibration.record import CertaintyRecord, ParameterRecord, read_as
from commonrail.plugins.certainty.file import Certainty
from commonrail.report.fit.certainty import certainty_lines, certainty_tables
from commonrail.report.fit.diagnostics import pair_figures
from commonrail.report.presenter import Array, Arrays, Presenter


def _lines(certainty: Certainty) -> list[str]:
    """Number of parameters by verdict, then the sentences of the report."""
    counts = Counter(judged.verdict for judged in certainty.verdicts)
    size = count_noun(len(certainty.verdicts), "parameter")
    counted_verdicts = [f"{counts[verdict]} {verdict.value}" for verdict in ParameterVerdict if counts[verdict]]
    return [f"{size}: {', '.join(counted_verdicts)}", *certainty_lines(read_as(CertaintyRecord, certainty.record()))]


def _tables(certainty: Certainty) -> list[Table]:
    """Tables of the report; intervals without bounds."""
    units = certainty.estimate.likelihood.units
    parameters = [ParameterRecord(name=name, unit=unit) for name, unit in zip(certainty.names, units, strict=False)]
    return certainty_tables(read_as(CertaintyRecord, certainty.record()), parameters)


def _arrays(certainty: Certainty) -> Arrays:
    """Values and intervals of the parameters in SI units, which a column names."""
    columns = {
        "value": certainty.point,
        "lower": certainty.low,
        "upper": certainty.high,
        "unit": np.array(certainty.estimate.likelihood.units[: certainty.d]),
        "verdict": np.array([judged.verdict.value for judged in certainty.verdicts]),
    }
    values = {name: Array(("parameter",), column) for name, column in columns.items()}
    return Arrays({"parameter": Array(("parameter",), np.array(certainty.names))}, values, "Certainty of a fit")


def _figures(certainty: Certainty) -> list[Figure]:
    """Draws of pairs of parameters, as in the report."""
    likelihood, points = certainty.estimate.likelihood, certainty.points
    parameters = [
        ParameterRecord(name=p.name, unit=p.unit, upper=p.upper, best=best)
        for p, best in zip(likelihood.space.parameters, certainty.values.values(), strict=False)
    ]
    return pair_figures(parameters, dict(zip(certainty.names, points.T, strict=True)), "most likely")


CERTAINTY = Presenter(_lines, _tables, _figures, _arrays)
