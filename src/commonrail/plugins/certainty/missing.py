"""Quantities that a model lacks: one is set free, all parameters are fitted again, and both fits are compared.

The parameters imitate most of a delay, or of friction, along a curved path: at the values that a fit without it ends
at, what is left of it points nowhere in particular, and a test of derivatives there has little power. All parameters
are therefore fitted anew with the quantity free, and the noise is estimated from what that fit leaves: with the noise
of the fit without it, an autoregression takes a delay for noise. The fall of 2 ln L is that of the same likelihood
with the quantity held at none.

Quantities that a study states as uncertain are fitted in both, with their standard deviations as priors. Of a delay
that is stated with the deviation s, the test then finds what is beyond: the fall of 2 ln L by a delay δ with the
standard error σ is δ²/(s² + σ²), the square of a normal variable where the delay is as stated.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy import special

from commonrail.base.arrays import Floats
from commonrail.base.text import quantity
from commonrail.calibration.optimisers.least_squares import FeasibleSet
from commonrail.calibration.parameter import Parameter
from commonrail.calibration.space import Space
from commonrail.calibration.study import Study
from commonrail.data.base import DataSet, Role
from commonrail.data.registry import of_role
from commonrail.physics.meters import Meter, is_of_meter, parts_of
from commonrail.plugins.certainty.ascent import Ascent, climb, covariance_at
from commonrail.plugins.certainty.covariance import Covariance
from commonrail.plugins.certainty.estimate import Estimate
from commonrail.plugins.certainty.likelihood import Likelihood
from commonrail.plugins.certainty.nuisance import wider, with_uncertain_free

FREED = 2  # of the ends of ascents with the quantity held, from which it is free
ROUNDS = 2  # of noise given residuals, with the quantity free
SEARCHES = 2  # with the quantity free: the second where the first has ended lower than that with the quantity held
TOLERANCE = 0.05  # of an ascent; a test at 1 % asks for falls of 6.6 and more
SOURCE = "test for lack of fit"
MANY = 1e6  # degrees of freedom from which F is χ²


CURVES, GUIDES = "all curves", "guides"  # names of the tests of a delay that they share, and of friction


class Missing(NamedTuple):
    """Test of a quantity that a model lacks."""

    values: Floats  # (q,), most likely values [SI] beyond what the study has
    probability: float  # largest probability that noise alone gains as much by it
    point: Floats  # (d,), parameters [SI] that belong to it
    simulated: int  # points simulated
    name: str = ""  # where it is looked for
    quantity: str = ""
    words: str = ""  # the quantity with its size, and what the study says of it


class _Fit(NamedTuple):
    """Fit of a study with all that it states as uncertain free."""

    study: Study
    likelihood: Likelihood  # with the noise of the estimate
    unit: Floats  # (d,), position of the estimate, its uncertain quantities at their stated values


def _with_stated_free(study: Study, estimate: Estimate, threads: int | None) -> _Fit | None:
    """Fit that quantities are set free beside; None if something that is stated cannot move."""
    likelihood, unit = estimate.likelihood, estimate.unit
    if not likelihood.nuisances:
        return _Fit(study, likelihood, unit)
    free = with_uncertain_free(study)
    if free is None:
        return None
    likelihood = Likelihood.of(free, threads).with_noises(likelihood.noises)
    return _Fit(free, likelihood, np.append(unit, likelihood.space.to_unit(likelihood.space.reference)[len(unit) :]))


def _compared(
    wide: Likelihood, fit: _Fit, starts: Floats, held: Callable[[Floats], Floats], turns: int = 0
) -> Missing | None:
    """Comparison of fits with the last parameters of a likelihood free and held; None if no start can be simulated.

    `starts` (k, d + q): positions that the search begins at, `turns` steps of it with the last parameters held; `held`:
    positions (h, d + q) that the fit without them begins at, by the end (1, d + q) of that with them. The probability
    is that of F with q degrees of freedom, the largest one where the quantities are never negative.
    """
    noisy, errors, d = wide.with_noises(fit.likelihood.noises), None, len(fit.unit)
    last = np.arange(d, starts.shape[1])
    if turns:
        ends = climb(noisy, starts, np.tile(last, (len(starts), 1)), turns=turns, tolerance=TOLERANCE)
        near = np.argsort(ends.cost, kind="stable")[:FREED]
        near = near[np.isfinite(ends.cost[near])]
        starts, errors = ends.unit[near], ends.errors[near]
    ends = climb(noisy, starts, errors=errors, tolerance=TOLERANCE)
    if not np.isfinite(ends.cost).any():
        return None
    free, used, fall = ends.best, [noisy], 0.0
    for _ in range(SEARCHES):
        for _ in range(ROUNDS):
            known, slopes = covariance_at(noisy, free)
            noisy = wide.estimated(free.errors[0], known.used.tolist(), known.root.T @ slopes)
            free = climb(noisy, free.unit, errors=free.errors, slopes=slopes[None], turns=10, tolerance=TOLERANCE)
            used.append(noisy)
        known, _ = covariance_at(noisy, free)
        without = held(free.unit)
        without_it = climb(noisy, without, np.tile(last, (len(without), 1)), tolerance=TOLERANCE).best
        fall = _cost_of(noisy, known, without_it) - _cost_of(noisy, known, free)
        if fall >= -TOLERANCE:
            break
        # a nested fit cannot be the better one: the search was caught in another maximum
        free = climb(noisy, without_it.unit, errors=without_it.errors, tolerance=TOLERANCE)
    fall = max(fall, 0.0)
    freedom = min(noise.freedom for block, noise in zip(noisy.blocks, noisy.noises, strict=True) if block.ordered)
    q, point = len(last), wide.space.from_unit(free.unit)[0]
    chance = special.chdtrc(q, fall) if freedom > MANY else special.fdtrc(q, freedom, fall / q)
    return Missing(point[d:], float(chance), point, sum(own.simulated for own in used))


def _cost_of(likelihood: Likelihood, known: Covariance, end: Ascent) -> float:
    """−2 ln L with each block's cost scaled as its law asks."""
    costs = likelihood.block_costs(likelihood.whiten(end.errors[0]))
    return float(known.ratios @ costs + likelihood.priors.costs(likelihood.space.from_unit(end.unit))[0])


# Delay of the meter.

DELAY = "delay"
UNNAMED = "unnamed"  # meter of a curve that has none
LARGEST = 50e-6  # delay that is looked for, to both sides [s]
# Delays that the search begins at [s]. Parameters and delay form several maxima, a few microseconds apart; fewer held
# steps, or starts that a linear model moves ahead, end in the wrong one under correlated noise.
BEGINS = np.array([-4e-6, -2e-6, 0.0, 2e-6, 4e-6])
HELD = 6  # steps with the delay held


class _Delayed(NamedTuple):
    """Fit without a delay, and the likelihood with one as its last parameter, whose noise is not known."""

    fit: _Fit
    wide: Likelihood
    stated: list[int]  # columns of the delays that the study states as uncertain


def missing_delay(study: Study, estimate: Estimate, threads: int | None = None) -> Missing | None:
    """Test of a delay that all curves share, each behind the meter that it has.

    None where no data set is a course in time, or a delay is free.
    """
    both = _with_delay(study, estimate, threads)
    if both is None:
        return None
    start = np.append(both.fit.unit, 0.5)[None]
    starts = np.repeat(start, len(BEGINS), axis=0)
    starts[:, -1] += BEGINS / (2.0 * LARGEST)

    def held(free: Floats) -> Floats:
        return np.vstack([start, _as_stated(both, free)]) if both.stated else start

    found = _compared(both.wide, both.fit, starts, held, HELD)
    if found is None:
        return None
    stated = any(nuisance.key == DELAY for nuisance in estimate.likelihood.nuisances)
    why = "which is beyond what the study states" if stated else "which the study lacks"
    words = f"a delay of the meter of about {quantity(float(found.values[0]), 's', 2)}, {why}"
    return found._replace(point=found.point[: len(estimate.unit)], name=CURVES, quantity=DELAY, words=words)


def _with_delay(study: Study, estimate: Estimate, threads: int | None) -> _Delayed | None:
    """Fit without, and likelihood with a delay; None if one is free, or no data set is a course in time."""
    free = {parts_of(name)[1] for name in estimate.likelihood.names if is_of_meter(name)}
    if DELAY in free or not any(block.ordered for block in estimate.likelihood.blocks):
        return None
    fit = _with_stated_free(study, estimate, threads)
    if fit is None:
        return None
    likelihood = fit.likelihood
    fitted = [_behind_a_meter(data) for data in of_role(fit.study.data, Role.FIT)]
    meters = {data.meter.name: data.meter for data in fitted if data.meter is not None and DELAY in data.meter_inputs}
    names = {meter.parameter(DELAY): meter.values.get(DELAY, 0.0) for meter in meters.values()}
    new = {name: present for name, present in names.items() if name not in likelihood.names}
    space = wider(likelihood.space, [_delay(name, present) for name, present in new.items()])
    all_free = Likelihood.of(replace(fit.study, data=tuple(fitted), space=space), threads)
    columns, present = [space.names.index(name) for name in names], np.array(list(new.values()))

    def residuals(points: Floats) -> Floats:
        values = np.column_stack([points[:, :-1], np.tile(present, (len(points), 1))])
        values[:, columns] += points[:, -1:]
        return all_free.residuals(values)

    stated = [likelihood.names.index(name) for name in names if name in likelihood.names]
    return _Delayed(fit, all_free.with_space(wider(likelihood.space, [_delay(DELAY, 0.0)]), residuals), stated)


def _as_stated(both: _Delayed, unit: Floats) -> Floats:
    """Positions (1, d + 1) with the delay of the test among those that the study states, as far as their bounds go.

    A search from the fitted values need not find them, and what it misses would count for the delay.
    """
    space = both.wide.space
    point = space.from_unit(unit)
    point[:, both.stated] += point[:, -1:]
    point[:, -1] = 0.0
    return np.clip(space.to_unit(point), 0.0, 1.0)


def _behind_a_meter(data: DataSet) -> DataSet:
    """A data set without uncertain quantities; a curve without a meter has a neutral one."""
    plain = data.changed(noise=replace(data.noise, uncertain={}))
    return plain if data.bounds is None or data.meter is not None else plain.changed(meter=Meter(UNNAMED))


def _delay(name: str, present: float) -> Parameter:
    return Parameter(name, present, present - LARGEST, present + LARGEST, "s", mark="E", source=SOURCE)


# Smallest delay that the test finds: what a fit without it leaves of the model's own curves with a delay.

POWER = 0.9  # probability with which `visible_delay` is found
# Share of the square of the distance that searches on a rippled likelihood see: two beds of virtual benches, of which
# 81 and 82 % found what 90 % should.
SEEN = 0.82
PARTS = np.array([0.3, 1.0])  # of the linear move by a delay, at which the search for its imitation begins
TRIALS, CLOSE = 4, 0.1  # of the search for the visible delay, and relative distance at which it ends
FIRST = 1e-6  # delay tried first [s]


def visible_delay(study: Study, estimate: Estimate, level: float, threads: int | None = None) -> tuple[float, int]:
    """Smallest delay [s] that a test at a level finds with the probability `POWER`, and the points simulated.

    NaN for none. The model's own curves at the estimate, with a delay, are the data; what a fit without the delay
    leaves of it in units of the noise is the square of the distance that the test sees.
    """
    both = _with_delay(study, estimate, threads)
    if both is None:
        return float("nan"), 0
    (_, own, unit), wide, d = both.fit, both.wide, len(estimate.unit)
    point, along = own.space.from_unit(unit), np.zeros(len(unit))
    wanted = float(special.ndtri(1.0 - 0.5 * level) + special.ndtri(POWER)) ** 2 / SEEN
    feasible, delay, simulated = FeasibleSet.of(own.space), FIRST, 0
    for _ in range(TRIALS):
        ends = wide.residuals(np.column_stack([np.tile(point, (2, 1)), [0.0, delay]]))
        shift = ends[1] - ends[0]
        moved = _with_data(own, point, -estimate.errors - shift)
        along[:d] = -estimate.position_shifts(shift[None])[0]  # linear; the path is curved
        starts = feasible.within(np.tile(unit, (len(PARTS), 1)), unit + PARTS[:, None] * along)
        share = float(climb(moved, starts, tolerance=TOLERANCE).cost.min()) / wanted
        simulated += moved.simulated + 2
        if not share > 0.0:
            return float("nan"), simulated
        delay = min(delay / float(np.sqrt(share)), LARGEST)
        if abs(np.sqrt(share) - 1.0) < CLOSE:
            break
    return delay, simulated


def _with_data(likelihood: Likelihood, point: Floats, shift: Floats) -> Likelihood:
    """The likelihood, with its noise, of data that make the residuals larger by a shift (n,).

    Priors lie about a point (d,) [SI]: a conflict between them and the measured data is none of the simulated ones.
    """
    parameters = [
        parameter if parameter.prior is None else replace(parameter, prior=replace(parameter.prior, value=float(at)))
        for parameter, at in zip(likelihood.space.parameters, point, strict=True)
    ]
    space = Space(parameters, likelihood.space.rows if len(likelihood.space.rows) else (), likelihood.space.products)
    moved = likelihood.with_space(space, lambda points: likelihood.residuals(points) + shift)
    return moved.with_noises(likelihood.noises)


# Friction of the guides, from zero upwards. Where a study states it as uncertain about zero it is no longer missing: it
# is fitted within its statement, see `one_sided`.

# Dry and viscous friction of each guide, and how much is looked for [N], [N s/m]; assumed, six times what is usual.
FRICTION = {"plunger_needle.friction": (30.0, "N"), "plunger_needle.viscous": (12.0, "N s/m")}
FRICTION_STARTS = np.array([[0.1, 0.1], [0.3, 0.05]])  # shares of these that the search begins at


def missing_friction(study: Study, estimate: Estimate, threads: int | None = None) -> Missing | None:
    """Test of friction in the guides of plunger and needle.

    None where no data set is a course in time, or the model has such friction: fixed, free or stated as uncertain.
    """
    likelihood = estimate.likelihood
    known = {*likelihood.names, *(nuisance.key for nuisance in likelihood.nuisances)}
    lacks = all(name not in known and study.injector.values.get(name) == 0.0 for name in FRICTION)
    fit = _with_stated_free(study, estimate, threads) if lacks and any(b.ordered for b in likelihood.blocks) else None
    if fit is None:
        return None
    more = [Parameter(name, 0.0, 0.0, most, unit, mark="E", source=SOURCE) for name, (most, unit) in FRICTION.items()]
    wide = Likelihood.of(replace(fit.study, space=wider(fit.likelihood.space, more)), threads)
    starts = np.column_stack([np.tile(fit.unit, (len(FRICTION_STARTS), 1)), FRICTION_STARTS])
    found = _compared(wide, fit, starts, lambda _: np.append(fit.unit, [0.0, 0.0])[None])
    if found is None:
        return None
    size = " and ".join(
        quantity(float(v), unit, 2) for v, (_, unit) in zip(found.values, FRICTION.values(), strict=True)
    )
    words = f"friction in the guides of about {size}, which the model lacks"
    return found._replace(point=found.point[: len(estimate.unit)], name=GUIDES, quantity="friction", words=words)
