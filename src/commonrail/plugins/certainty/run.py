"""Certainty of a calibration: most likely values, intervals, tests and verdicts, as a JSON-able record."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from commonrail.base.arguments import fraction, instance, integer, thread_count
from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError, InputError, SimulationError
from commonrail.calibration.constraints import parse_constraints
from commonrail.calibration.identifiability import LIMIT, FinishedFit
from commonrail.calibration.result import CERTAINTY
from commonrail.calibration.study import Study
from commonrail.plugins.certainty.ascent import FEW
from commonrail.plugins.certainty.draws import Draws, draw
from commonrail.plugins.certainty.estimate import Estimate, assimilated, bounded, estimate, library, starts_from
from commonrail.plugins.certainty.file import Certainty
from commonrail.plugins.certainty.lack_of_fit import fixed_changes, lack_of_fit, withdrawal
from commonrail.plugins.certainty.likelihood import Likelihood
from commonrail.plugins.certainty.relief import Relief
from commonrail.plugins.certainty.uncertain import with_uncertain_free
from commonrail.plugins.certainty.verdict import verdicts_of

MEMBERS = 512  # simulated candidates for further starts: eight ensembles
NORMAL_DRAWS = 4000  # from the normal distribution, if sampling fails
FAR = 3.0  # distance beyond which an end point is another local optimum
TOPS = 2  # other local optima that are examined


def certainty(
    study: Study,
    best: Mapping[str, float],
    *,
    threads: int | None = None,
    starts: int = 1,
    ends: Floats | None = None,
    combinations: Sequence[str] = (),
    level: float = 0.95,
    limit: float = LIMIT,
    keep: bool | None = False,
    seed: int = 0,
    note: Callable[[str], None] = lambda _: None,
) -> Certainty:
    """Certainty of a study's fit.

    Parameters
    ----------
    study : Study
    best : mapping of str to float
        Values [SI] to start from, as `Calibration.best`.
    threads : int, optional
        All usable processors by default; the result does not depend on it.
    starts : int
        Starts of the search for the most likely values: the best values, and others far from each other.
    ends : (k, d), optional
        Values [SI] of further starts, such as the end points of a search.
    combinations : sequence of str
        Sums of parameters that also get an interval, such as "a + b" or "2*a - b".
    level : float
        Confidence level: share of intervals that contain the true value.
    limit : float
        Largest ratio of half width to value of a determined parameter.
    keep : bool, optional
        If True, the given values remain the calibrated values, and the intervals contain them. None: only if a test
        rejects the likelihood, which then does not show which values fit best.
    seed : int
        Seed of the draws.
    note : function of str
        Called before long steps.

    Raises
    ------
    ConfigurationError
        If an argument has the wrong type, or a name is unknown.
    SimulationError
        If the best values cannot be simulated.
    """
    instance(study, Study, "study")
    starts = integer(starts, "starts", 1)
    level, limit, seed = fraction(level, "level"), fraction(limit, "limit"), integer(seed, "seed", 0)
    threads, d = thread_count(threads), study.space.dimension
    free = with_uncertain_free(study)
    likelihood = Likelihood.of(free, threads)
    rows = {text: read_combination(text, likelihood.names[:d]) for text in combinations}
    points = study.space.point(best)[None] if ends is None else np.vstack([study.space.point(best), ends])
    middle = np.tile(likelihood.space.reference[d:], (len(points), 1))
    begin = np.clip(likelihood.space.to_unit(np.column_stack([points, middle])), 0.0, 1.0)
    if starts > len(begin):
        note(f"searching from {starts} starts ...")
        choose = assimilated if len(likelihood.names) > FEW else starts_from
        begin = np.vstack([begin, choose(likelihood, library(likelihood, MEMBERS), starts - len(begin))])
    result = estimate(likelihood, begin, first=d)
    note("drawing from the posterior ...")
    result, draws = drawn(result, seed)
    calibrated = None if keep is False else study.space.point(best)
    return assess(
        free, result, draws, d, rows, calibrated=calibrated, keep=keep, level=level, limit=limit, threads=threads
    )


def drawn(result: Estimate, seed: int) -> tuple[Estimate, Draws]:
    """Estimate at the best local optimum of the search, and draws around it.

    The likeliest end points far from the best one are examined, each with its own noise: complete likelihoods are
    compared.
    """
    best, draws = _draws_or_normal(result, seed)
    away = np.flatnonzero(_distances(result, result.ends) > FAR)
    if not len(away):
        return best, draws
    likelihood = result.likelihood
    errors = likelihood.residuals(likelihood.space.from_unit(result.ends[away]))
    costs = np.nan_to_num(likelihood.block_costs(likelihood.whiten(errors)).sum(axis=-1), nan=np.inf)
    for i in away[np.argsort(costs, kind="stable")][:TOPS].tolist():
        try:
            other = estimate(likelihood, result.ends[i : i + 1], rounds=1)
        except SimulationError:
            continue
        if other.whole_cost > best.whole_cost:
            continue
        agreeing = int(np.count_nonzero(_distances(other, result.ends) <= FAR))
        other = replace(other, starts=result.starts, agreeing=agreeing, ends=result.ends)
        another, more = _draws_or_normal(other, seed)
        if not more.refusal and another.whole_cost < best.whole_cost:
            best, draws = another, more
    return best, draws


def _distances(result: Estimate, unit: Floats) -> Floats:
    """Distances (k,) of positions (k, d) from an estimate, in standard errors; root mean square over d."""
    covariance = bounded(result.covariance.noise)
    root = np.linalg.cholesky(covariance + 1e-12 * np.eye(len(covariance)))
    return np.asarray(np.linalg.norm((unit - result.unit) @ np.linalg.inv(root).T, axis=1) / np.sqrt(len(covariance)))


def _draws_or_normal(result: Estimate, seed: int) -> tuple[Estimate, Draws]:
    """Draws around an estimate; from its normal distribution if too few positions nearby can be simulated."""
    try:
        return draw(result, seed)
    except SimulationError as error:
        normal = np.random.default_rng(seed).multivariate_normal(
            result.unit, bounded(result.covariance.noise), NORMAL_DRAWS, method="svd"
        )
        return result, Draws(np.clip(normal, 0.0, 1.0), np.inf, 0.0, np.inf, 0, False, False, 0, str(error))


def assess(
    study: Study,
    result: Estimate,
    draws: Draws,
    d: int,
    rows: Mapping[str, Floats],
    *,
    calibrated: Floats | None = None,
    keep: bool | None = False,
    level: float = 0.95,
    limit: float = LIMIT,
    threads: int | None = None,
) -> Certainty:
    """Intervals, tests and verdicts of an estimate and its draws.

    `study`: study whose uncertain quantities are free; `d`: number of parameters of the original study, which come
    first; `rows`: coefficients (d,) of sums, by text; `calibrated` (d,): values [SI] that remain the calibrated values
    according to `keep`, see `certainty`.
    """
    space = result.likelihood.space
    points = space.from_unit(draws.unit)
    low, high = np.quantile(points[:, :d], [0.5 * (1.0 - level), 0.5 * (1.0 + level)], axis=0)
    if draws.refusal:  # rather too wide than too narrow: include the interval of the curvature
        half = result.half_widths(level)[:d] * np.abs(result.likelihood.scaled(result.unit))[:d]
        low, high = np.minimum(low, result.point[:d] - half), np.maximum(high, result.point[:d] + half)
    tests = lack_of_fit(result, d, fixed_changes(study, result, threads))
    reason = withdrawal(result, tests, draws.refusal)
    wrong = bool(reason) or any(noise.share for noise in result.likelihood.noises)
    values = calibrated if calibrated is not None and (keep or wrong) else result.point[:d]
    for point in (result.point[:d], values):
        low, high = np.minimum(low, point), np.maximum(high, point)
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = np.nan_to_num(np.corrcoef(draws.unit.T).reshape(len(result.unit), -1))
    judged = replace(result, point=np.append(values, result.point[d:]))
    verdicts = verdicts_of(judged, d, (low, high), correlation, reason, limit=limit, level=level)
    points = points[:, :d]
    sums = {text: _combined(float(row @ values), points @ row, level) for text, row in rows.items()}
    widening = Relief(result).of_bounds(d)
    return Certainty(result, values, draws, d, level, low, high, correlation, tests, reason, verdicts, sums, widening)


def _combined(value: float, drawn_sums: Floats, level: float) -> tuple[float, float, float]:
    """Value of a sum and ends of its interval, which holds the value."""
    low, high = np.quantile(drawn_sums, [0.5 * (1.0 - level), 0.5 * (1.0 + level)])
    return value, min(float(low), value), max(float(high), value)


def judge(fit: FinishedFit) -> None:
    """Part "certainty" after a fit: most likely values with their intervals and verdicts, and the record."""
    study = fit.calibration.study
    others = [end.x for end in fit.calibration.ends[1 : 1 + MOST_ENDS]]
    keep = True if study.method.is_evolution else None  # the paper's search keeps its own values
    ends = np.array(others) if others else None
    result = certainty(study, fit.calibration.best, threads=fit.threads, ends=ends, starts=fit.starts, keep=keep)
    stays = result.values == dict(fit.calibration.best)
    fit.identified.estimate = None if stays else result.values
    fit.identified.draws = result.points[:: max(len(result.points) // KEPT, 1)]
    record = result.record()
    fit.shared[CERTAINTY], fit.identified.sections[CERTAINTY] = result, record
    for parameter in record["parameters"]:
        fit.identified[parameter["name"]] |= {key: parameter[key] for key in ("standard_error", "verdict")}


KEPT = 1000  # draws in a run folder
MOST_ENDS = 3  # end points of the search that are further starts


def read_combination(text: str, names: Sequence[str], what: str = "combination") -> Floats:
    """Coefficients (d,) of a sum of parameters; `InputError`, with `what` as its first words, if it is none."""
    reason = "is no sum of free parameters"
    try:
        rows = parse_constraints([f"{text} >= 0"], names)
        if len(rows.matrix) == 1 and not rows.lower.any():
            return np.asarray(rows.matrix[0])
    except (InputError, ConfigurationError) as error:
        if error.code == "not-free":
            reason = str(error).partition('" ')[2].partition(": ")[0]
    raise InputError(f'{what} "{text}" {reason}; write a sum such as "{names[0]}" or "a + 2*b" of {", ".join(names)}.')
