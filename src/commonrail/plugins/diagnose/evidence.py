"""Probabilities of faults from measured quantities.

Quantities of parts with a fault of size s scatter about the mean m(s) with the covariance C(s), both estimated from
simulated parts, and are measured with independent noise R. The evidence of a fault is

    p(y | fault) = ∫ t(y; m(s), C(s) + R) ds,    s uniform from 0, the least, to 1, the most,

with Student's multivariate t, since a covariance from few parts is uncertain (Gelman et al., Bayesian Data Analysis,
3.6). Bayes' theorem gives the posterior probabilities (Jaynes, Probability Theory, chapter 4). If a result departs from
sound parts, sizes at which the fault moves the quantity away from the result are excluded: far from all means, the
widest distribution has the largest density, even on the wrong side.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.interpolate import PchipInterpolator, interp1d
from scipy.special import chdtrc, logsumexp

from commonrail.base.arrays import Floats
from commonrail.base.hooks import note
from commonrail.physics.injector import Injector
from commonrail.plugins.diagnose.faults import Fault, Parts

SIZES = np.linspace(0.0, 1.0, 7)  # sizes at which parts are simulated
FINE = np.linspace(0.0, 1.0, 61)  # sizes over which the evidence is summed; interpolated between the simulated ones
RESOLUTION = 0.01e-9  # of a bench [m³], also without injection: an estimate
# Degrees of freedom of that distribution. 64 parts less 14 parameters and 8 tests leave about 40; the value is lower
# for deviations from normality. Chosen by the logarithmic score on parts that the trial does not use.
FREEDOM = 30.0
DEPARTS = 2.0  # standard deviations of measured sound parts beyond which a result departs from them; chosen
SLIGHT = 0.02  # standard deviations: a fault that moves a result less is taken to leave it unchanged; chosen
SPARE_DRAWS = 8  # parts that the fit of a covariance needs beyond its number of coefficients

Simulate = Callable[[Parts], Floats]  # quantities (parts, tests) [m³], NaN where a simulation failed


class BenchNoise(NamedTuple):
    """Noise of a bench: shares of the quantities, and standard deviations at zero [m³]; each (tests,) or a scalar."""

    shares: Floats | float
    floors: Floats | float = RESOLUTION

    def deviation(self, mean: Floats) -> Floats:
        """Standard deviations of quantities (…, tests) [m³]."""
        return np.hypot(self.shares * mean, self.floors)


class Response(NamedTuple):
    """Quantities of parts with a fault: `mean` (sizes, tests) [m³] and covariance `scatter` (sizes, tests, tests) [m⁶].

    Sound parts have the fault None and a single size.
    """

    fault: Fault | None
    sizes: Floats
    mean: Floats
    scatter: Floats

    @property
    def name(self) -> str:
        """Name of the fault, or "sound"."""
        return "sound" if self.fault is None else self.fault.name

    def scale(self, factors: Floats) -> Response:
        """Multiply the quantities by factors (tests,)."""
        return self._replace(mean=self.mean * factors, scatter=self.scatter * np.outer(factors, factors))


def moments(parts: Parts, centre: Floats, quantities: Floats) -> tuple[Floats, Floats] | None:
    """Mean (tests,) and covariance (tests, tests) of quantities (parts, tests) whose parameters scatter about `centre`.

    A linear regression on the parameters lets few parts suffice: the covariance is the sum of the linear part and of
    the residuals. None if too few parts could be simulated.
    """
    complete = np.isfinite(quantities).all(axis=1)
    z, y = (parts.values - centre)[complete], quantities[complete]
    n, d = z.shape
    if n < d + 1 + SPARE_DRAWS:
        return None
    design = np.column_stack([np.ones(n), z / (np.abs(centre) + (centre == 0.0))])
    slopes = np.linalg.lstsq(design, y, rcond=None)[0]
    rest = y - design @ slopes
    linear = np.atleast_2d(np.cov(design[:, 1:], rowvar=False))
    return slopes[0], slopes[1:].T @ linear @ slopes[1:] + rest.T @ rest / (n - d - 1)


def responses(
    injector: Injector, parts: Parts, centre: Floats, faults: Sequence[Fault], simulate: Simulate
) -> tuple[Response, ...]:
    """Responses of sound parts and of parts with each fault.

    `parts`: sound parts; `centre` (names,): the part as drawn [SI]. A fault that cannot be simulated is omitted with a
    note.
    """
    sound = moments(parts, centre, simulate(parts))
    if sound is None:
        return ()
    fault_responses = [Response(None, np.zeros(1), sound[0][None], sound[1][None])]
    for item in faults:
        by_size = [(s, moments(parts, centre, simulate(parts.with_fault(injector, item, s)))) for s in SIZES.tolist()]
        usable = [(s, *pair) for s, pair in by_size if pair is not None]
        if len(usable) < 2:
            note(f"Parts with the fault {item.name} could not be simulated; the fault is omitted.")
            continue
        sizes, mean, scatter = (np.array(column) for column in zip(*usable, strict=True))
        fine = FINE[(sizes[0] <= FINE) & (sizes[-1] >= FINE)]
        fault_responses.append(
            Response(item, fine, PchipInterpolator(sizes, mean)(fine), interp1d(sizes, scatter, axis=0)(fine))
        )
    return tuple(fault_responses)


class Judged(NamedTuple):
    """Posterior probabilities (responses,), distribution over the sizes of each response, and goodness of fit.

    `weights[i]` (sizes,) sums to 1; `fit` (responses,) is the share of parts that lie farther from the mean than the
    measured quantities, at the best size, by χ² (with the covariance taken as certain).
    """

    probabilities: Floats
    weights: tuple[Floats, ...]
    fit: Floats

    @property
    def order(self) -> list[int]:
        """Indices of the responses, most probable first."""
        return [int(i) for i in np.argsort(-self.probabilities, kind="stable")]


def regress_on_first(covariance: Floats, n: int) -> tuple[Floats, Floats]:
    """Regress normal variables on the first n of them: gain (others, n) and residual variances (others,)."""
    gain = np.asarray(np.linalg.solve(covariance[:n, :n], covariance[:n, n:]).T, float)
    return gain, np.diag(covariance)[n:] - np.einsum("ij,ji->i", gain, covariance[:n, n:])


def judge(
    fault_responses: Sequence[Response],
    measured: Floats,
    noise: BenchNoise,
    sound: float,
    *,
    fails: Sequence[bool] | bool = False,
    freedom: float = FREEDOM,
) -> Judged:
    """Compute the posterior probabilities of faults.

    `fault_responses`: sound parts first; `measured` (tests,) [m³]; `sound`: prior probability of a sound part, all
    faults being equally likely; `fails` (tests,): results outside their bands; `freedom`: degrees of freedom of the
    covariances, above 2. A fault has probability zero if each of its sizes moves a quantity in the wrong direction by
    more than `SLIGHT`, for a result that fails or departs from sound parts.
    """
    prior = np.log(
        np.where([r.fault is None for r in fault_responses], sound, (1.0 - sound) / max(len(fault_responses) - 1, 1))
    )
    middle, scatter = fault_responses[0].mean[0], fault_responses[0].scatter[0]
    deviation = np.hypot(np.sqrt(np.diag(scatter)), noise.deviation(middle))
    departure = (measured - middle) / deviation
    departs = np.where(np.asarray(fails) | (np.abs(departure) > DEPARTS), np.sign(departure), 0.0)
    logs: list[Floats] = []
    weights: list[Floats] = []
    fits: list[Floats] = []
    for r in fault_responses:
        residual = measured - r.mean
        spread = noise.deviation(r.mean)
        covariance = r.scatter + spread[:, :, None] * np.eye(residual.shape[1]) * spread[:, None, :]
        scale = np.sqrt(np.einsum("sii->si", covariance))
        matrix = covariance / (scale[:, :, None] * scale[:, None, :])
        x = (residual / scale)[:, :, None]
        distance = np.einsum("sti,sti->s", x, np.linalg.solve(matrix, x))
        tails = (freedom + len(measured)) * np.log1p(distance / (freedom - 2.0))
        log = -0.5 * (tails + np.linalg.slogdet(matrix)[1]) - np.log(scale).sum(axis=1)
        contrary = np.any((r.mean - middle) * departs < -SLIGHT * deviation, axis=1)
        allowed = np.where(contrary, -np.inf, log)
        logs.append(logsumexp(allowed) - np.log(len(log)))
        shown = log if contrary.all() else allowed
        weights.append(np.exp(shown - logsumexp(shown)))
        fits.append(chdtrc(residual.shape[1], distance[np.argmax(shown)]))
    joint = prior + np.array(logs)
    return Judged(np.exp(joint - logsumexp(joint)), tuple(weights), np.array(fits))
