"""Reference point for the next part of a type: the one whose quantity tells most of the part's other quantities."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from commonrail.arguments import file_path, instances, number, thread_count, whole
from commonrail.arrays import Floats
from commonrail.calibration.injector_type import InjectorType
from commonrail.calibration.parameter import Parameter
from commonrail.calibration.prior import Prior
from commonrail.calibration.sampling import sample_priors
from commonrail.calibration.space import Space
from commonrail.calibration.time_step import step_for_all
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.simulate import simulate_batch
from commonrail.engine.status import OK
from commonrail.errors import InputError, SimulationError
from commonrail.family.adapt import FACTORS, FLOW, held_parameters, part_of
from commonrail.files.type_file import load_type
from commonrail.injector.definition import Injector
from commonrail.kinds.maps.reading import AFTER_ENERGISING
from commonrail.parts.furniture import Domain
from commonrail.reading.tables import Column, read_columns

__all__ = ["FLOW_SPREAD", "Advice", "advise", "grid", "read_candidates"]


DRAWS = 256
FLOW_SPREAD = 0.03  # standard deviation of the flow of a nozzle about its drawing: an estimate of the tolerance
SCALES = 41  # flow factors at which the type is simulated; quantities between them are interpolated
USABLE = 0.95  # share of the drawn parts that a point must serve to be advised
QUANTILE = 0.9
RAIL_PRESSURES = (40e6, 80e6, 120e6, 160e6)  # [Pa]
ENERGISING_TIMES = (300e-6, 400e-6, 500e-6, 700e-6, 1000e-6, 1400e-6)  # [s]


@dataclass(frozen=True)
class Advice:
    """Expected errors of the adapted type, for each candidate as the only reference point.

    Attributes
    ----------
    points : tuple of OperatingPoint
        Candidates, and the points whose quantities are predicted.
    expected : (points,)
        Root mean square error of the quantities at the other points, over points and drawn parts [m³]; NaN where the
        candidate serves no part.
    upper : (points,)
        Root mean square error over the points that 90 % of the drawn parts stay below [m³].
    usable : (points,)
        Share of the drawn parts that inject there, and whose quantity a flow factor from 0.6 to 1.6 meets.
    without : float
        Root mean square error of the type itself, without any reference [m³].
    draws : int
        Drawn parts that could be simulated.
    """

    points: tuple[OperatingPoint, ...]
    expected: Floats
    upper: Floats
    usable: Floats
    without: float
    draws: int

    @property
    def order(self) -> tuple[int, ...]:
        """Candidates that serve nearly all parts, the smallest expected error first."""
        ranked = np.argsort(self.expected, kind="stable").tolist()
        return tuple(i for i in ranked if self.usable[i] >= USABLE)


def advise(
    injector_type: InjectorType | str | Path,
    points: Sequence[OperatingPoint],
    *,
    injector: Injector | str | Path | None = None,
    flow_spread: float | str = FLOW_SPREAD,
    draws: int = DRAWS,
    seed: int = 1,
    threads: int | None = None,
) -> Advice:
    """Rank reference points before anything was measured on the part.

    Parts are drawn from the type: each parameter from the normal distribution of its scatter between parts (`between`),
    within the bounds, and the flow of the nozzle. Where the type states no scatter between parts for any parameter, its
    whole spreads are drawn from. For each candidate, the type is given the flow factor at which it injects what
    the drawn part injects there, as `adapt` does it with one quantity, and is compared with the drawn part at all other
    points. No measured quantity of the part is used.

    The errors of the type's own values are left out: data hold combinations of the parameters more closely than each
    one, and a type file holds no correlations. So the expected error is that of the parts' scatter alone, and a type
    that misses the measured parts by more will miss the next one too. Of a type without `between` it is too large for
    the same reason; the order of the points is then what the ranking is for.

    Parameters
    ----------
    injector_type : InjectorType or path
    points : sequence of OperatingPoint
        Candidates, at least two; the quantities at all of them are what the model is to predict.
    injector : Injector, name or path, optional
        The part as `adapt` takes it; by default the type's injector.
    flow_spread : float or str
        Standard deviation of the effective hole area about the drawing, as a share.
    draws : int
        Number of parts that are drawn.
    seed : int
    threads : int, optional
        All usable processors by default; the result does not depend on it.

    Returns
    -------
    Advice

    Raises
    ------
    InputError
        If a file cannot be read, there is no injector, or there are fewer than two points.
    ConfigurationError
        If an argument is of another kind.
    SimulationError
        If no drawn part could be simulated.
    """
    known = injector_type if isinstance(injector_type, InjectorType) else load_type(injector_type)
    part = part_of(known, injector)
    at = instances(points, OperatingPoint, "points")
    if len(at) < 2:
        raise InputError("A reference point is chosen among at least two points; give more candidates.")
    share, count = number(flow_spread, "1", "flow_spread"), whole(draws, "draws", 2, 100_000)
    space = Space([_flow(part, share), *_scattering(known, part)])
    own, scaled = _simulated(part, at, space, (count, whole(seed, "seed")), thread_count(threads))
    return _advice(at, own, scaled)


def grid(cylinder_pressure: float | str = 5e6, return_pressure: float | str = 5e5) -> tuple[OperatingPoint, ...]:
    """Candidates at 40 to 160 MPa and 300 to 1400 µs.

    Parameters
    ----------
    cylinder_pressure, return_pressure : float or str
        [Pa], or texts with their units.
    """
    behind = cylinder_pressure, return_pressure
    return tuple(_point(p, t, *behind) for p in RAIL_PRESSURES for t in ENERGISING_TIMES)


def read_candidates(
    path: str | Path, cylinder_pressure: float | str = 5e6, return_pressure: float | str = 5e5
) -> tuple[OperatingPoint, ...]:
    """Read candidates from a CSV file with columns rail_pressure and energising_time; other columns are ignored.

    Parameters
    ----------
    path : str or Path
    cylinder_pressure, return_pressure : float or str
        [Pa], or texts with their units.

    Raises
    ------
    InputError
        If the file cannot be read, or a column is missing or of the wrong kind.
    """
    wanted = [Column("rail_pressure", ("Pa",)), Column("energising_time", ("s",), domain=Domain.POSITIVE)]
    table = read_columns(file_path(path, "path of the candidates"), wanted, least=2).columns
    rows = zip(table["rail_pressure"].tolist(), table["energising_time"].tolist(), strict=True)
    return tuple(_point(p, t, cylinder_pressure, return_pressure) for p, t in rows)


def _point(pressure: float, duration: float, cylinder: float | str, returned: float | str) -> OperatingPoint:
    return OperatingPoint(pressure, duration, cylinder, returned, horizon=duration + AFTER_ENERGISING)


def _flow(part: Injector, share: float) -> Parameter:
    """Effective hole diameter of the next part; the area is the square of the diameter."""
    own = part.values[FLOW]
    low, high = (own * factor**0.5 for factor in FACTORS)
    source = "spread of the flow of a nozzle about its drawing"
    prior = Prior(own, 0.5 * share * own, source)
    return Parameter(FLOW, own, low, high, "m", mark="E", source=source, prior=prior)


def _scattering(known: InjectorType, part: Injector) -> list[Parameter]:
    """Parameters of the type that scatter between parts, with that scatter as prior."""
    held = held_parameters(known, part)
    between = {p.name: p.between for p in known.parameters if p.between is not None}
    if not between:
        return held
    return [
        replace(p, prior=Prior(known.by_name[p.name].value, scatter, p.source))
        for p in held
        if (scatter := between.get(p.name, 0.0))
    ]


def _simulated(
    part: Injector, points: Sequence[OperatingPoint], space: Space, drawn: tuple[int, int], threads: int | None
) -> tuple[Floats, Floats]:
    """Quantities [m³] of drawn parts (n, points) and of the type with flow factors, NaN where that fails.

    A drawn part that fails anywhere is left out: it is none that is sold.
    """
    step, (count, seed) = step_for_all(part, space), drawn
    values = sample_priors(space, count, np.random.default_rng(seed))
    scaled = np.tile(space.reference, (SCALES, 1))
    scaled[:, 0] *= _factors() ** 0.5
    batch = simulate_batch(part, points, space.names, np.vstack([values, scaled]), time_step=step, threads=threads)
    quantity, good = batch.injected_volume, np.all(batch.status == OK, axis=1)
    scaled_quantity = np.where(batch.status[count:] == OK, quantity[count:], np.nan)
    if not good[:count].any() or np.any(np.sum(np.isfinite(scaled_quantity), axis=0) < SCALES // 2):
        raise SimulationError("the type could not be simulated at all points; take others, or check its spreads.")
    return quantity[:count][good[:count]], scaled_quantity


def _factors() -> Floats:
    return np.linspace(*FACTORS, SCALES)


def _advice(points: tuple[OperatingPoint, ...], own: Floats, scaled: Floats) -> Advice:
    """Errors of the adapted type for each candidate.

    Parameters
    ----------
    points : tuple of OperatingPoint
    own : (draws, points)
        Quantities of the drawn parts [m³].
    scaled : (factors, points)
        Those of the type with flow factors.
    """
    count = len(points)
    expected, upper, usable = np.full(count, np.nan), np.full(count, np.nan), np.zeros(count)
    for i in range(count):
        errors = _errors(own, scaled, i)
        good = np.isfinite(errors)
        usable[i] = np.mean(good)
        if good.any():
            expected[i] = np.sqrt(np.mean(errors[good] ** 2))
            upper[i] = np.quantile(errors[good], QUANTILE)
    plain = np.array([_interpolated(np.ones(1), column)[0] for column in scaled.T])
    return Advice(points, expected, upper, usable, float(np.sqrt(np.mean((own - plain) ** 2))), len(own))


def _errors(own: Floats, scaled: Floats, reference: int) -> Floats:
    """Root mean square errors (draws,) at the other points with a candidate's quantity met; NaN where it cannot be."""
    known = np.isfinite(scaled[:, reference])
    rising = scaled[known, reference]
    if not np.all(np.diff(rising) > 0.0):
        return np.full(len(own), np.nan)
    factor = np.interp(own[:, reference], rising, _factors()[known], left=np.nan, right=np.nan)
    predicted = np.stack([_interpolated(factor, column) for column in scaled.T], axis=1)
    others = np.arange(own.shape[1]) != reference
    return np.asarray(np.sqrt(np.mean((predicted - own)[:, others] ** 2, axis=1)))


def _interpolated(factor: Floats, quantity: Floats) -> Floats:
    """Quantities at flow factors, of those (factors,) at the scale that are known; NaN beyond them."""
    known = np.isfinite(quantity)
    return np.asarray(np.interp(factor, _factors()[known], quantity[known], left=np.nan, right=np.nan))
