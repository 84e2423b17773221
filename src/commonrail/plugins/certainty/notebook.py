"""Presenters of the certainty of a fit and of draws from its posterior: what notebooks show of them."""

from __future__ import annotations

from collections import Counter

import numpy as np

from commonrail.base.chart import Figure
from commonrail.base.table import Table
from commonrail.base.text import counted, fixed, significant
from commonrail.calibration.identifiability import ParameterVerdict
from commonrail.data.records import Record
from commonrail.plugins.certainty.file import Certainty
from commonrail.plugins.certainty.posterior import Posterior
from commonrail.plugins.certainty.posterior_file import posterior_record
from commonrail.report.fit.certainty import certainty_lines, certainty_tables, posterior_table
from commonrail.report.fit.diagnostics import pair_figures
from commonrail.report.presenter import Array, Arrays, Presenter


def _lines(found: Certainty) -> list[str]:
    """Number of parameters by verdict, then the sentences of the report."""
    counts = Counter(judged.verdict for judged in found.verdicts)
    size = counted(len(found.verdicts), "parameter")
    named = [f"{counts[verdict]} {verdict.value}" for verdict in ParameterVerdict if counts[verdict]]
    return [f"{size}: {', '.join(named)}", *certainty_lines(_kept(found))]


def _kept(found: Certainty) -> Record:
    """Record as result.json keeps it, with the units of the parameters."""
    likelihood = found.estimate.likelihood
    parameters = [{"name": name, "unit": unit} for name, unit in zip(likelihood.names, likelihood.units, strict=True)]
    return {"parameters": parameters, "certainty": found.record()}


def _posterior_lines(found: Posterior) -> list[str]:
    """Number of draws and agreement of the chains."""
    chains, steps, size = found.unit.shape
    state = f"refused: {found.refusal}" if found.refusal else "chains agree"
    worst, fewest = significant(float(found.r_hat.max()), 4), fixed(float(found.effective.min()), 0)
    return [
        f"{chains * steps} draws of {counted(size, 'parameter')}; {state}; largest R-hat {worst}, at least {fewest} "
        "effective draws"
    ]


def _posterior_tables(found: Posterior) -> list[Table]:
    """Table of the report: medians and intervals, R-hat, effective draws."""
    units = dict(zip(found.names, found.estimate.likelihood.units, strict=True))
    return [posterior_table(posterior_record(found), units)]


def _posterior_figures(found: Posterior) -> list[Figure]:
    """Draws of pairs of parameters, as in the report."""
    likelihood, points = found.estimate.likelihood, found.points()
    upper = likelihood.space.from_unit(np.ones(points.shape[1]))
    columns = zip(found.names, likelihood.units, upper.tolist(), found.estimate.point.tolist(), strict=True)
    parameters = [dict(zip(("name", "unit", "upper", "best"), column, strict=True)) for column in columns]
    return pair_figures({"parameters": parameters}, dict(zip(found.names, points.T, strict=True)), "most likely")


def _arrays(found: Certainty) -> Arrays:
    """Values and intervals of the parameters in SI units, which a column names."""
    likelihood = found.estimate.likelihood
    columns = {
        "value": np.asarray(found.estimate.point),
        "lower": found.low,
        "upper": found.high,
        "unit": np.array(likelihood.units),
        "verdict": np.array([judged.verdict.value for judged in found.verdicts]),
        "estimator": np.array(found.estimators),
    }
    values = {name: Array(("parameter",), column) for name, column in columns.items()}
    return Arrays({"parameter": Array(("parameter",), np.array(likelihood.names))}, values, "Certainty of a fit")


def _posterior_arrays(found: Posterior) -> Arrays:
    """Draws, a column for each parameter in SI units."""
    points = found.points()
    names = zip(found.names, found.estimate.likelihood.units, strict=True)
    values = {name: Array(("draw",), points[:, i], unit.removesuffix("1")) for i, (name, unit) in enumerate(names)}
    return Arrays({"draw": Array(("draw",), np.arange(len(points)))}, values, "Draws from the posterior")


CERTAINTY = Presenter(_lines, lambda found: certainty_tables(_kept(found)), arrays=_arrays)
POSTERIOR = Presenter(_posterior_lines, _posterior_tables, _posterior_figures, _posterior_arrays)
