"""Parts drawn from a type, tests whether a measured part is one of them, and limits of its adapted model."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc

from commonrail.base.arrays import Floats
from commonrail.base.errors import SimulationError
from commonrail.base.hooks import quiet
from commonrail.base.text import join_words, to_signed
from commonrail.calibration.parameter import Parameter, Prior
from commonrail.calibration.run import Calibration
from commonrail.calibration.space import Space, sample_priors
from commonrail.calibration.study import step_for_all
from commonrail.data.quantities.data import QuantityData
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.simulate import simulate, simulate_batch
from commonrail.engine.status import OK
from commonrail.physics.injector import Injector, parameter_quantities
from commonrail.plugins.diagnose.evidence import RESOLUTION, BenchNoise, Response, judge, responses
from commonrail.plugins.diagnose.faults import SEAT_LEAK, Change, Fault, Parts, load_shipped_faults
from commonrail.plugins.family.injector_type import InjectorType

FLOW = "nozzle.hole_diameter"  # its square is the area: the flow factor scales c_d A at every lift and pressure
FACTORS = (0.6, 1.6)  # range of flow factors to be searched
DRAWS = 256
FLOW_SPREAD = 0.03  # standard deviation of the flow of a nozzle about its drawing: an estimate of the tolerance


def parameters_with_priors(injector_type: InjectorType, injector: Injector) -> list[Parameter]:
    """Return the type's parameters with priors, except parameters measured on the part."""
    measured = {p.name for p in injector_type.parameters} - {p.name for p in injector_type.parameters_for(injector)}
    units = parameter_quantities()
    return [
        Parameter(p.name, p.value, p.lower, p.upper, units[p.name].unit, mark=p.mark, source=p.source, prior=p.prior)
        for p in injector_type.parameters
        if p.name != FLOW and p.name not in measured
    ]


def flow_about_drawing(injector: Injector, share: float) -> Parameter:
    """Return the effective hole diameter of the next part as a parameter; `share`: relative spread of the hole area."""
    drawing_diameter = injector.values[FLOW]
    low, high = (drawing_diameter * factor**0.5 for factor in FACTORS)
    source = "spread of the flow of a nozzle about its drawing"
    prior = Prior(drawing_diameter, 0.5 * share * drawing_diameter, source)
    return Parameter(FLOW, drawing_diameter, low, high, "m", mark="E", source=source, prior=prior)


def scattering_parameters(injector_type: InjectorType, injector: Injector) -> list[Parameter]:
    """Return the type's parameters that scatter between parts, with this scatter as prior."""
    parameters = parameters_with_priors(injector_type, injector)
    between = {p.name: p.between for p in injector_type.parameters if p.between is not None}
    if not between:
        return parameters
    return [
        replace(p, prior=Prior(injector_type.by_name[p.name].value, scatter, p.source))
        for p in parameters
        if (scatter := between.get(p.name, 0.0))
    ]


def draw_quantities(
    injector_type: InjectorType,
    injector: Injector,
    points: Sequence[OperatingPoint],
    threads: int | None = None,
    flow_spread: float = FLOW_SPREAD,
) -> Floats:
    """Draw parts from a type and return their quantities (n, points) [m³]; parts that fail at a point are left out.

    Parameters are drawn independently, since a type file has no correlations. `flow_spread`: relative standard
    deviation of the flow about the drawing.
    """
    space = Space([flow_about_drawing(injector, flow_spread), *scattering_parameters(injector_type, injector)])
    values = sample_priors(space, DRAWS, np.random.default_rng(1))
    batch = simulate_batch(
        injector, points, space.names, values, time_step=step_for_all(injector, space), threads=threads
    )
    sound = np.all(batch.status == OK, axis=1)
    if np.count_nonzero(sound) < 2:
        raise SimulationError("No part drawn from the type could be simulated at all points; check its spreads.")
    return np.asarray(batch.injected_volume[sound])


# Each test doubts one in a hundred sound parts, if the parts scatter as the type states.
RARE = 0.01  # probability
FAR = 2.58  # a normal variable lies this many standard deviations out with the probability `RARE`
BAND = (0.05, 0.95)
LEAST = 0.03  # smallest relative change of a value of the type that may explain a part
HALF, DOUBLE = -0.5, 1.0  # largest relative changes
EXTRA_PARTS = 24  # drawn parts for each size of each change, in addition to the number of parameters
LEAST_FREEDOM = 3.0  # degrees of freedom of Student's t with a finite covariance
REPORTED_PROBABILITY = 0.9  # the likeliest changes are reported until they reach this probability


class Doubts(NamedTuple):
    """Reasons to doubt that a part is a sound part of its type.

    Attributes
    ----------
    low, high : (points,)
        90 % band of the quantities of the type's parts, measured with the tolerance of the data [m³].
    chi2 : float
        Sum of squared residuals and pulls of the adapted model.
    freedom : int
        Degrees of freedom: the number of quantities, because each parameter has a prior; one less if the flow factor
        has no prior.
    pulls : dict of str to float
        Distance of each parameter from the type, in spreads; empty for a single quantity.
    sentences : tuple of str
        Reasons; empty for a sound part.
    change : str
        The single change of the type that explains the quantities best.
    """

    low: Floats
    high: Floats
    chi2: float
    freedom: int
    pulls: dict[str, float]
    sentences: tuple[str, ...]
    change: str


def find_doubts(
    injector_type: InjectorType,
    injector: Injector,
    points: QuantityData,
    fit: Calibration,
    threads: int | None,
    flow_spread: float,
) -> Doubts:
    """Test whether a part adapted from a type is a sound part of the type.

    `injector`: the injector before the fit; `fit`: fit of the flow factor and, with two or more quantities, of the
    type's parameters; `flow_spread`: relative standard deviation of the flow about the drawing.
    """
    judged = points.judged
    drawn = draw_quantities(injector_type, injector, points.points, threads, flow_spread)
    random = np.random.default_rng(2)
    drawn = drawn + random.normal(size=drawn.shape) * np.nan_to_num(points.discrepancy(drawn))
    low, high = np.quantile(np.maximum(drawn, 0.0), BAND, axis=0)
    pulls = {p.name: p.prior.residual(fit.best[p.name]) for p in fit.study.space.parameters if p.prior is not None}
    chi2, freedom = fit.cost, int(np.count_nonzero(judged)) - (not pulls)
    sentences = []
    share = _share_at_distance(drawn[:, judged], points.quantity[judged])
    if share <= RARE:
        sentences.append(
            f"only {share:.1%} of {len(drawn)} parts drawn from the type deviate as much from the others as this part"
        )
    if pulls:
        if chdtrc(freedom, chi2) < RARE:
            sentences.append(f"chi-squared is {chi2:.3g} instead of {freedom}")
        far = [f"{name} by {pull:+.1f}" for name, pull in pulls.items() if abs(pull) > FAR]
        if far:
            sentences.append(f"distance from the type in standard deviations: {join_words(far)}")
    if shut := describe_no_injection(points, drawn):
        sentences.append(shut)
    change = explain_by_one_change(injector_type, injector, points, threads, flow_spread) if sentences else ""
    return Doubts(low, high, chi2, freedom, pulls, tuple(sentences), change)


def describe_no_injection(points: QuantityData, injected: Floats) -> str:
    """Describe the first point where nothing was measured and parts (n, points) [m³] all inject; empty without one."""
    least, resolved = injected.min(axis=0), FAR * points.absolute
    for i in np.flatnonzero(points.judged & (points.quantity <= resolved) & (least > 2.0 * resolved)).tolist():
        return (
            f"nothing was measured at {at_point(points.points[i])}, where the type injects"
            f"{' at least' if len(injected) > 1 else ''} {least[i] * 1e9:.3g} mm³"
        )
    return ""


def at_point(point: OperatingPoint) -> str:
    """Rail pressure and energising time in words."""
    duration = sum(pulse.duration for pulse in point.pulses)
    return f"{1e-6 * point.initial_pressures()[0]:.4g} MPa and {1e6 * duration:.4g} µs"


def _share_at_distance(drawn: Floats, measured: Floats) -> float:
    """Share of the drawn parts (n, points) at least as far from their mean as the measured quantities (points,).

    The distance is Mahalanobis'; the measured part counts as one of the parts.
    """
    middle = drawn.mean(axis=0)
    inverse = np.linalg.pinv(np.atleast_2d(np.cov(drawn, rowvar=False)))
    deviations = np.vstack([drawn, measured]) - middle
    distance = np.einsum("ki,ij,kj->k", deviations, inverse, deviations)
    return float(np.mean(distance >= distance[-1]))


def explain_by_one_change(
    injector_type: InjectorType,
    injector: Injector,
    points: QuantityData,
    threads: int | None = None,
    flow_spread: float = FLOW_SPREAD,
) -> str:
    """Describe the fault, or the change of one value of the type, that explains the reference quantities best.

    Each change is tried with all its sizes on parts drawn from the type (`plugins/diagnose/evidence.py`). The likeliest
    changes are named until they reach `REPORTED_PROBABILITY`. Empty if no change explains the quantities within the
    scatter of the type and the tolerance of the data, if a sound part is likelier, or if nothing is injected at any
    point: many changes explain that equally well.
    """
    if not np.any(points.quantity[points.judged] > FAR * points.absolute):
        return ""
    space = Space([flow_about_drawing(injector, flow_spread), *scattering_parameters(injector_type, injector)])
    parts = Parts(tuple(space.names), sample_priors(space, space.dimension + EXTRA_PARTS, np.random.default_rng(3)))
    names = dict.fromkeys(
        [
            FLOW,
            *(p.name for p in parameters_with_priors(injector_type, injector)),
            *(v.name for v in injector_type.fixed),
        ]
    )
    faults = [f for f in load_shipped_faults().of_model(injector) if SEAT_LEAK not in f.names]
    fault_changes = {(f.names, f.changes[0].most > 0.0) for f in faults}
    faults += [
        Fault(name, "", (Change(name, math.copysign(LEAST, most), most, True),))
        for name in names
        for most in (HALF, DOUBLE)
        if injector.values[name] and ((name,), most > 0.0) not in fault_changes
    ]
    step = step_for_all(injector, space)
    at = [p for p, is_judged in zip(points.points, points.judged, strict=True) if is_judged]

    def simulate(changed_parts: Parts) -> Floats:
        batch = simulate_batch(injector, at, changed_parts.names, changed_parts.values, time_step=step, threads=threads)
        return np.where(batch.status == OK, batch.injected_volume, np.nan)

    with quiet():  # a change that cannot be simulated explains nothing
        candidate_responses = responses(injector, parts, parts.values.mean(axis=0), faults, simulate)
    if len(candidate_responses) < 2:
        return ""
    measured, tolerance = points.quantity[points.judged], points.discrepancy(points.quantity)[points.judged]
    # with a covariance of m degrees of freedom, Student's t of q quantities has m - q + 1 (Gelman et al., 3.6)
    noise = BenchNoise(0.0, tolerance)
    judged = judge(candidate_responses, measured, noise, 0.5, freedom=max(EXTRA_PARTS - len(measured), LEAST_FREEDOM))
    first, *_ = order = judged.order
    if candidate_responses[first].fault is None or judged.fit[first] < RARE:
        return ""
    last = int(np.searchsorted(np.cumsum(judged.probabilities[order]), REPORTED_PROBABILITY))
    likeliest = [i for i in order[: last + 1] if candidate_responses[i].fault]
    return join_words([_describe_change(injector, candidate_responses[i], judged.weights[i]) for i in likeliest])


def _describe_change(injector: Injector, response: Response, weights: Floats) -> str:
    """Describe a change with its likeliest size: weak valve spring (valve.spring_preload 57.4 N (−30 %))."""
    assert response.fault is not None
    size = response.fault.size_text(injector, float(response.sizes[np.argmax(weights)]))
    name = response.fault.names[0]
    return f"{name} {size}" if response.name == name else f"{response.name} ({name} {size})"


# Limits of an adapted model.


def describe_missed_references(points: QuantityData, adapted: Floats) -> list[str]:
    """Warn of reference quantities that the adapted model (points,) [m³] misses by more than their tolerance."""
    errors = adapted - points.quantity
    texts = [
        f"{points.quantity[i] * 1e9:.4g} mm³ at {at_point(points.points[i])} by {to_signed(errors[i] * 1e9, 2)} mm³"
        for i in np.flatnonzero(np.abs(errors) > points.discrepancy(points.quantity)).tolist()
    ]
    return [f"the adapted model misses references by more than their tolerance: {join_words(texts)}"] if texts else []


def describe_shut_points(
    fit: Calibration, adapted: Injector, points: Sequence[OperatingPoint], threads: int | None = None
) -> list[str]:
    """Warn of points where the adapted model does not inject: whether the type injects, and the first reason."""
    space = fit.study.space
    values = np.array([space.reference, [fit.best[name] for name in space.names]])
    batch = simulate_batch(
        fit.study.injector, points, space.names, values, time_step=fit.study.time_step, threads=threads
    )
    of_type, injected = batch.injected_volume
    shut = np.flatnonzero((batch.status[1] == OK) & (injected < RESOLUTION)).tolist()
    words = [f"{at_point(points[i])}{' (nor does the type)' * bool(of_type[i] < RESOLUTION)}" for i in shut]
    places = join_words(list(dict.fromkeys(words)))
    return [f"the adapted model injects nothing at {places}: {_why_shut(adapted, points[shut[0]])}"] if shut else []


def _why_shut(injector: Injector, point: OperatingPoint) -> str:
    """Say which component does not move if an injector injects nothing."""
    lift = simulate(injector, point).channels.get("valve_lift", np.ones(1))  # a direct-acting injector has no valve
    return "the needle stays shut" if lift.max() > 0.0 else "the coil does not lift the valve"
