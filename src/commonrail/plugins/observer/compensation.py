"""Energising times that deliver target quantities, by the model with the states estimated by an observer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize.elementwise import bracket_root, find_root

from commonrail.base.arguments import amount, array, instance, instances, thread_count
from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError
from commonrail.base.hooks import check_stop, naming, note
from commonrail.engine import lanes, plan
from commonrail.engine.operating_point import ENERGISING_TIMES, OperatingPoint
from commonrail.engine.status import which_failed
from commonrail.physics.injector import Injector
from commonrail.plugins.observer.file import Compensated, Observation
from commonrail.plugins.observer.response import Simulator, find_cuts, find_figures
from commonrail.plugins.observer.study import GAIN, OFFSET, InjectionTrain, ObserverSettings

SHORTEST, LONGEST = 20e-6, 5e-3  # range of the search for energising times [s]; no injector answers a shorter one
SINGLE = np.geomspace(80e-6, 3e-3, 40)  # start values, from single injections [s]
NEAR = 0.02  # half width of the first bracket, as a share; chosen
MET = 1e-3  # largest miss of a quantity that counts as met, as a share: a tenth of the scatter of shots
NARROWEST = 10e-9  # width of a bracket below which a missed quantity counts as skipped by a jump [s], as in a map
TAKEN = 0.5  # share of the change of energising times that is applied; chosen on 6 parts, as in compensation_trial
SAME_RAIL = 0.05  # largest relative difference of the median rail pressure from log to log; chosen [E]
ITERATIONS = 20  # after ten, a bracket that doubles covers all energising times


def compensate(
    source: Injector | Observation,
    trains: Sequence[InjectionTrain],
    settings: ObserverSettings | None = None,
    *,
    last: Sequence[Compensated] | None = None,
    threads: int | None = None,
) -> list[Compensated]:
    """Find energising times with which trains deliver their quantities, including interaction of the injections.

    If the injector does not deliver the quantities of a train, or jumps over them, the train has the
    nearest times that were tried, and a note counts it.

    Parameters
    ----------
    source : Injector or Observation
        A model without changes, or the model of an observation with its states after the last shot.
    trains : sequence of InjectionTrain
        All with the same number of injections.
    settings : ObserverSettings, optional
        Pressures and time step for an injector; an observation has its own.
    last : sequence of Compensated, optional
        The same trains with their present times, at rail pressures within 5 %: the new times go half of the way
        from these, which damps the scatter of the states from log to log.
    threads : int, optional
        Default: all usable processors; the result does not depend on it.

    Notes
    -----
    Injections are solved in order, because later injections do not affect earlier ones. Each is bracketed,
    then solved by Chandrupatla's method (Advances in Engineering Software 28, 1997; `scipy.optimize.elementwise`), for
    all trains in parallel. Dwells are fixed: later energisings move when an earlier energising grows.

    Raises
    ------
    ConfigurationError
        If an argument is of the wrong type, settings are given for an observation, trains differ in their number of
        injections or from `last`, or the states leave the domain of a parameter or the fuel.
    """
    instance(source, Injector | Observation, "source")
    targets = instances(trains, InjectionTrain, "trains")
    present = None if last is None else _read_last_times(last, targets)
    if len({len(train.quantities) for train in targets}) != 1:
        raise ConfigurationError("One call takes one or more trains with equally many injections.")
    if isinstance(source, Observation):
        if settings is not None:
            raise ConfigurationError("An observation has its own settings; omit `settings`.")
        injector, settings = source.injector, source.settings
    else:
        injector = source
        settings = ObserverSettings() if settings is None else instance(settings, ObserverSettings, "settings")
    nominal = learnt = _Model(injector, settings, thread_count(threads) or 1)
    if isinstance(source, Observation):
        learnt = nominal.at(source.memory.belief.mean)
    plain = _solve_single(nominal, targets)
    times = _solve(learnt, targets, plain)
    delivered = learnt.quantities(targets, times)
    met = np.all(np.abs(delivered / [train.quantities for train in targets] - 1.0) <= MET, axis=1)
    if not met.all():
        note(f"{np.sum(~met)} of {len(met)} trains miss their quantities; check the delivered ones.")
    if present is not None:
        times = present + TAKEN * (times - present)
        delivered = learnt.quantities(targets, times)
    before = learnt.quantities(targets, plain)
    return [
        Compensated(train, times[k], delivered[k], plain[k], before[k], bool(met[k])) for k, train in enumerate(targets)
    ]


def _read_last_times(last: Sequence[Compensated], trains: Sequence[InjectionTrain]) -> Floats:
    """Read energising times (trains, injections) [s] of earlier compensations of these trains."""
    earlier = instances(last, Compensated, "last")
    before = instances([train.train for train in earlier], InjectionTrain, "trains of last")
    times = [array(train.energising_times, "s", "energising times of last", 1).tolist() for train in earlier]
    if [(train.quantities, train.dwells, len(train.quantities)) for train in trains] != [
        (train.quantities, train.dwells, len(row)) for train, row in zip(before, times, strict=True)
    ] or any(abs(b.rail_pressure / a.rail_pressure - 1.0) > SAME_RAIL for a, b in zip(trains, before, strict=True)):
        raise ConfigurationError(
            "`last` must hold times for the same quantities and dwells as the trains, in their order, and rail "
            f"pressures within {100.0 * SAME_RAIL:g} %; give the compensation of these trains, or none."
        )
    return np.array([[amount(t, "s", "energising time of last", ENERGISING_TIMES) for t in row] for row in times])


@dataclass(frozen=True)
class _Model:
    """Quantities of trains; `gain` and `offset` [Pa] belong to the sensor that shows the rail pressure."""

    injector: Injector
    settings: ObserverSettings
    threads: int
    gain: float = 0.0
    offset: float = 0.0

    def at(self, states: Floats) -> _Model:
        """Model with the states (states,) of an observer."""
        simulator = Simulator(self.injector, self.settings)
        values = simulator.values(states[None])[0].tolist()
        sensor = {state.name: float(x) for state, x in zip(self.settings.states, states, strict=True)}
        injector = self.injector.with_values(dict(zip(simulator.names, values, strict=True)))
        return _Model(injector, self.settings, self.threads, sensor.get(GAIN, 0.0), sensor.get(OFFSET, 0.0))

    def quantities(self, trains: Sequence[InjectionTrain], times: Floats) -> Floats:
        """Quantities (trains, injections) [m³] for energising times of that shape [s]; NaN if a simulation fails."""
        check_stop()
        settings, dt = self.settings, self.settings.time_step
        pulses = [train.energisings(row) for train, row in zip(trains, times, strict=True)]
        longest = max(each[-1].start + each[-1].duration for each in pulses) + settings.after
        around, horizon = (settings.cylinder_pressure, settings.return_pressure), float(dt * np.ceil(longest / dt))
        rails = [(train.rail_pressure - self.offset) / (1.0 + self.gain) for train in trains]
        points = [OperatingPoint(*pair, *around, horizon=horizon) for pair in zip(rails, pulses, strict=True)]
        prepared = plan.prepare(self.injector, points, dt)
        job, variant = plan.make_job(prepared, prepared.row[None], False), self.injector.wired()
        with naming(f"{variant.label}, f64"):
            outcome, trace = lanes.run(job, variant, traced=True, threads=self.threads, injected_only=True)
        failed = which_failed(plan.statuses_of((), job.theta, prepared, outcome))[0]
        injected = np.empty((len(points), trace.shape[1]))
        injected[job.points[:, : trace.shape[3]]] = np.moveaxis(trace[:, :, 0], 1, 2)
        clock, masses = np.asarray(dt * np.arange(trace.shape[1]), float), np.full(times.shape, np.nan)
        for k in np.flatnonzero(~failed):
            masses[k] = find_figures(clock, injected[k], find_cuts(clock, injected[k], pulses[k]))[0]
        return np.asarray(masses / prepared.densities[0][:, None])


def _solve(model: _Model, trains: Sequence[InjectionTrain], first: Floats) -> Floats:
    """Find energising times (trains, injections) [s] that deliver trains, or the nearest that were tried.

    `first` (trains, injections): start values [s].
    """
    times, which = first.copy(), np.arange(float(len(trains)))
    for i in range(times.shape[1]):
        nearest, least = times[:, i].copy(), np.full(len(trains), np.inf)

        def miss(time: Floats, train: Floats, i: int = i, nearest: Floats = nearest, least: Floats = least) -> Floats:
            k = train.astype(int)
            tried = times[k]
            tried[:, i] = time
            some = [trains[j] for j in k]
            errors = np.asarray(model.quantities(some, tried)[:, i] / [train_j.quantities[i] for train_j in some] - 1.0)
            for j, train_j, size in zip(k, time, np.abs(errors), strict=True):
                if size < least[j]:
                    nearest[j], least[j] = train_j, size
            return errors

        low, high = (1.0 - NEAR) * times[:, i], (1.0 + NEAR) * times[:, i]
        around = bracket_root(miss, low, high, xmin=SHORTEST, xmax=LONGEST, args=(which,), maxiter=ITERATIONS)
        close = {"fatol": MET, "xatol": NARROWEST}
        root = find_root(miss, around.bracket, args=(which,), tolerances=close, maxiter=ITERATIONS)
        times[:, i] = np.where(root.success, root.x, nearest)
    return times


def _solve_single(model: _Model, trains: Sequence[InjectionTrain]) -> Floats:
    """Find energising times (trains, injections) [s] of single injections; each pair of values is solved once."""
    pairs = [[(train.rail_pressure, volume) for volume in train.quantities] for train in trains]
    alone = [InjectionTrain(rail, (volume,)) for rail, volume in sorted({pair for row in pairs for pair in row})]
    rails = sorted({train.rail_pressure for train in trains})
    grid = [InjectionTrain(rail, (1e-9,)) for rail in rails for _ in SINGLE]
    table = model.quantities(grid, np.tile(SINGLE, len(rails))[:, None]).reshape(len(rails), -1)
    rising = dict(zip(rails, np.maximum.accumulate(np.nan_to_num(table), axis=1), strict=True))
    first = [[np.interp(train_alone.quantities[0], rising[train_alone.rail_pressure], SINGLE)] for train_alone in alone]
    solutions = _solve(model, alone, np.array(first))[:, 0].tolist()
    times = {
        (train_alone.rail_pressure, train_alone.quantities[0]): time
        for train_alone, time in zip(alone, solutions, strict=True)
    }
    return np.array([[times[pair] for pair in row] for row in pairs])
