"""Certainty of a calibration: most likely values, intervals, profiles, tests and verdicts, as a JSON-able record."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from commonrail.base.arguments import fraction, instance, thread_count, whole
from commonrail.base.arrays import Floats
from commonrail.base.errors import InputError
from commonrail.base.text import listed
from commonrail.calibration.constraints import parse_constraints
from commonrail.calibration.identifiability import LIMIT, FinishedFit, ParameterVerdict, outside_joint_region
from commonrail.calibration.result import CERTAINTY
from commonrail.calibration.study import Study
from commonrail.data.noise import Law
from commonrail.plugins.certainty.ascent import FEW
from commonrail.plugins.certainty.covariance import student
from commonrail.plugins.certainty.estimate import AGREED, Estimate, assimilated, library, starts_from
from commonrail.plugins.certainty.file import Certainty
from commonrail.plugins.certainty.lack_of_fit import DRIFT, LackOfFit, assess_residuals, of_missing, with_drift
from commonrail.plugins.certainty.likelihood import Likelihood
from commonrail.plugins.certainty.missing import Missing, missing_delay, missing_friction, visible_delay
from commonrail.plugins.certainty.one_sided import Within, estimate_within
from commonrail.plugins.certainty.profile import Profile, Ripple, profiles_of, ripple_of
from commonrail.plugins.certainty.verdict import Assessment, verdicts_of, withdrawal

MEMBERS = 512  # of the library from which further starts are chosen: eight ensembles
MANY = 1e6  # degrees of freedom from which a quantile of Student's t is a normal one
PROFILED = "profile likelihood"
MOST_RESTARTS = 3  # from profile points that beat the optimum
CLOSE = AGREED**0.5  # standard errors one parameter is off where a smooth likelihood has fallen by `AGREED`


def certify(
    study: Study,
    best: Mapping[str, float],
    *,
    threads: int | None = None,
    starts: int = 1,
    profiles: Sequence[str] | None = (),
    combinations: Sequence[str] = (),
    level: float = 0.95,
    limit: float = LIMIT,
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
    profiles : sequence of str or None
        Parameters whose likelihood is profiled; None for all. By default those whose likelihood is rippled, where no
        more than five parameters are free.
    combinations : sequence of str
        Sums of parameters, such as "a + b" or "2*a - b", whose interval is wanted too.
    level : float
        Share of intervals that are to hold the truth.
    limit : float
        Half width over value, up to which a parameter is called pinned.
    note : function of str
        Called before long steps, and with what the user should know.

    Raises
    ------
    ConfigurationError
        If an argument is of another kind, or a name is unknown.
    SimulationError
        If the best values cannot be simulated.
    """
    instance(study, Study, "study")
    starts = whole(starts, "starts", 1)
    level, limit = fraction(level, "level"), fraction(limit, "limit")
    likelihood = Likelihood.of(study, thread_count(threads))
    wanted = list(likelihood.names) if profiles is None else list(profiles)
    columns = [likelihood.column(name) for name in wanted]
    rows = {text: _row(likelihood, text) for text in combinations}
    point = likelihood.space.point(best)
    begin = likelihood.space.to_unit(point)[None]
    if starts > 1:
        note(f"searching from {starts} starts ...")
        members = library(likelihood, MEMBERS)
        choose = assimilated if len(likelihood.names) > FEW else starts_from
        begin = np.vstack([begin, choose(likelihood, members, starts - 1)])
    within = estimate_within(study, likelihood, begin, thread_count(threads))
    simulated, adopted = likelihood.simulated + within.whole.simulated, 0
    profiled: dict[str, Profile] = {}
    ripple = None if columns or within.fitted else ripple_of(within.whole)
    if ripple is not None:
        simulated += ripple.simulated
        columns = np.flatnonzero(ripple.rippled).tolist() if len(likelihood.names) <= FEW else []
    while columns:
        note(f"profiling {len(columns)} parameters ...")
        done = profiles_of(within.whole, columns, level)
        simulated += done.simulated
        if done.better is None or adopted == MOST_RESTARTS:
            profiled = {} if done.better is not None else {profile.name: profile for profile in done.found}
            break
        starts_again = np.vstack([done.better[None], *([within.whole.ends] if starts > 1 else [])])
        again = estimate_within(study, likelihood, starts_again, thread_count(threads))
        simulated += again.whole.simulated
        if within.whole.apart(again.whole.unit) <= CLOSE:  # the ripple of the same top, where a profile means nothing
            ripple = None if within.fitted else ripple_of(within.whole)
            simulated += 0 if ripple is None else ripple.simulated
            break
        note("a profile has met a better fit, which is adopted")
        adopted, within = adopted + 1, again
    tests, visible, more = _tests(within, thread_count(threads))
    drifting = [test.name for test in tests if test.found and test.suspect == DRIFT]
    within = within._replace(whole=with_drift(within.whole, drifting), found=with_drift(within.found, drifting))
    found = within.found
    low, high, estimators = _intervals(within, profiled, level)
    if ripple is not None:
        low, high = _widened(found.interval(level), (low, high), ripple, estimators)
    if drifting:
        estimators = [f"{label}, drift added" for label in estimators]
    gain = _gain(found, point)
    reason = withdrawal(found, tests) or _unconfirmed(found, gain) or _not_falling(ripple, estimators)
    verdicts = verdicts_of(found, low, high, reason, limit=limit, level=level)
    friction = friction_withdraws(within.study, within.whole, verdicts, thread_count(threads))
    if friction is not None:
        tests, more = [*tests, of_missing(friction, within.level)], more + friction.simulated
        reason = withdrawal(found, tests) or reason
        verdicts = verdicts_of(found, low, high, reason, limit=limit, level=level)
    return Certainty(
        found,
        level,
        low,
        high,
        estimators,
        profiled,
        tests,
        visible,
        reason,
        verdicts,
        adopted,
        {text: _combined(found, row, level) for text, row in rows.items()},
        simulated + more + 2,
        within,
        gain,
        ripple,
    )


def judge(fit: FinishedFit) -> None:
    """Part "certainty" after a fit: standard errors and verdicts of `certify`, and its record."""
    found = certify(fit.calibration.study, fit.calibration.best, threads=fit.threads)
    record = found.record()
    fit.shared[CERTAINTY], fit.identified.sections[CERTAINTY] = found, record
    for one in record["parameters"]:
        fit.identified[one["name"]] |= {key: one[key] for key in ("standard_error", "verdict")}


def _gain(found: Estimate, point: Floats) -> float:
    """2 ln L of the most likely values less that of a point (d,) [SI]; NaN if that cannot be simulated."""
    likelihood, points = found.likelihood, np.array([found.point, point])
    costs = likelihood.block_costs(likelihood.whiten(likelihood.residuals(points))).sum(
        axis=1
    ) + likelihood.priors.costs(points)
    return float(costs[1] - costs[0])


def _widened(
    local: tuple[Floats, Floats], ends: tuple[Floats, Floats], ripple: Ripple, estimators: list[str]
) -> tuple[Floats, Floats]:
    """Ends of the intervals where the likelihood is rippled, whose estimators are labelled in place.

    The wider of profile and curvature; without a profile, the curvature times the measured ratio.
    """
    low, high = (np.array(end) for end in ends)
    for i in np.flatnonzero(ripple.rippled):
        if estimators[i].startswith(PROFILED):
            low[i], high[i] = min(low[i], local[0][i]), max(high[i], local[1][i])
            estimators[i] += ", the likelihood is rippled: not narrower than the curvature"
        elif 1.0 < ripple.ratios[i] < np.inf:
            middle, ratio = 0.5 * (low[i] + high[i]), ripple.ratios[i]
            low[i], high[i] = middle + ratio * (low[i] - middle), middle + ratio * (high[i] - middle)
            estimators[i] += f", the likelihood is rippled: {ratio:.2f} times as wide"
    return low, high


def _unconfirmed(found: Estimate, gain: float) -> str:
    """Reason to withdraw verdicts where one start left the fitted values far behind and no other was compared with it.

    On 18 virtual benches of a map and 120 shots (`tools/walk_bench.py`) four fits that no other test withdraws
    ended so, three of them at another optimum, with truths up to 23 standard errors from it.
    """
    if found.starts > 1 or not outside_joint_region(gain, len(found.unit)):
        return ""
    return "the likelihood has a better fit than these values, and no search from other starts has confirmed it"


def _not_falling(ripple: Ripple | None, estimators: Sequence[str]) -> str:
    """Reason to withdraw verdicts where the likelihood does not fall beside the optimum and there is no profile."""
    if ripple is None:
        return ""
    rises = zip(ripple.ratios, estimators, strict=True)
    bad = any(np.isposinf(ratio) and not label.startswith(PROFILED) for ratio, label in rises)
    return "the likelihood is rippled, and no lower two standard errors from the most likely values" if bad else ""


def _tests(within: Within, threads: int | None) -> tuple[list[LackOfFit], float, int]:
    """Tests for lack of fit, the smallest delay that they find, and the points simulated."""
    study, found = within.study, within.whole
    delay = missing_delay(study, found, threads)
    tests, simulated = assess_residuals(study, found, delay, threads, priors_from=len(within.found.unit))
    if delay is None:
        return tests, float("nan"), simulated
    visible, more = visible_delay(study, found, within.level, threads)
    return tests, visible, simulated + delay.simulated + more


def friction_withdraws(
    study: Study, found: Estimate, verdicts: Sequence[Assessment], threads: int | None
) -> Missing | None:
    """Test of friction that the model lacks, made where a parameter is called pinned: it can only withdraw that.

    `verdicts`: without this test.
    """
    pinned = any(one.verdict is ParameterVerdict.PINNED for one in verdicts)
    return missing_friction(study, found, threads) if pinned else None


def _row(likelihood: Likelihood, text: str) -> Floats:
    """Coefficients (d,) of a sum of parameters."""
    try:
        return np.asarray(parse_constraints([f"{text} >= 0"], likelihood.names).matrix[0])
    except InputError as error:
        words = str(error).replace(f'constraint "{text} >= 0"', f'the combination "{text}"')
        raise InputError(f"{words}: {', '.join(likelihood.names)}.") from error


def _combined(found: Estimate, row: Floats, level: float) -> tuple[float, float]:
    slope = row * found.likelihood.scaled(found.unit)
    used = slope != 0.0
    total = np.where(np.isfinite(found.covariance.total), found.covariance.total, 0.0)
    if not np.isfinite(np.diag(found.covariance.total)[used]).all():
        return float(row @ found.point), float("inf")
    quantile = float(student(np.array([found.covariance.freedom[used].min()]), level)[0])
    return float(row @ found.point), quantile * float(np.sqrt(slope @ total @ slope))


def _intervals(within: Within, profiled: Mapping[str, Profile], level: float) -> tuple[Floats, Floats, list[str]]:
    """Ends of the intervals, and the estimator of each."""
    found = within.found
    low, high = (np.array(end) for end in found.interval(level))
    way = (
        "fitted as stated"
        if within.integrated
        else "fitted as stated, too few draws agree: wider of these and the curvature"
    )
    fitted = f", {listed(list(within.fitted))} {way}" if within.fitted else ""
    local = _local_label(found) + fitted
    labels = [local] * len(low)
    scale = np.abs(found.likelihood.scaled(found.unit))
    nuisances, discrepancy = found.covariance.nuisances, found.covariance.discrepancy
    beyond = np.sum(nuisances**2, axis=0) + np.diag(discrepancy)
    wider = student(found.covariance.freedom, level) ** 2 * beyond * scale**2
    for i, name in enumerate(found.likelihood.names):
        profile = profiled.get(name)
        if profile is None or not (profile.low.finished and profile.high.finished):
            continue
        below = found.point[i] - np.hypot(found.point[i] - profile.low.value, np.sqrt(wider[i]))
        above = found.point[i] + np.hypot(profile.high.value - found.point[i], np.sqrt(wider[i]))
        if within.fitted:  # a profile takes these quantities at their best, the interval as they may be
            below, above = min(low[i], below), max(high[i], above)
            if (below, above) == (low[i], high[i]):
                continue
        low[i], high[i] = below, above
        labels[i] = ", ".join([PROFILED, *(_added(found) if wider[i] else [])]) + fitted
    return low, high, labels


def _local_label(found: Estimate) -> str:
    """Name of the local estimator, with the laws of noise that it rests on."""
    laws = list(dict.fromkeys(noise.law.value for noise in found.likelihood.noises))
    orders = [noise.autoregression.order for noise in found.likelihood.noises]
    white = f"AR({max(orders)})" if max(orders) else "white"
    parts = [f"curvature of the likelihood over the interval ({', '.join(laws)}, {white})"]
    if Law.STUDENT.value in laws:
        parts.append("outliers, their scale and freedom integrated out")
    parts.append("t quantile" if (found.covariance.freedom < MANY).any() else "normal quantile")
    return ", ".join([*parts, *_added(found)])


def _added(found: Estimate) -> list[str]:
    """Names of the errors beside the noise that an interval holds."""
    parts = ["error of the time step added"]
    if found.likelihood.nuisances:
        parts.append("uncertain quantities added")
    if any(block.noise.discrepancy for block in found.likelihood.blocks):
        parts.append("discrepancy added")
    if found.starts > 1:
        parts.append("other tops of the search added")
    return parts
