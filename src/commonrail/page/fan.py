"""Fan of a page: several fits that explain the data almost as well as the best one, or parts that scatter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from commonrail.analysis.neighbourhood import around
from commonrail.arrays import Floats
from commonrail.calibration.goal import Goal
from commonrail.calibration.objective import Objective
from commonrail.calibration.prior import Priors
from commonrail.calibration.study import Study
from commonrail.files.posterior_file import POSTERIOR, RefusedDrawsError, read_posterior
from commonrail.injector.definition import Injector
from commonrail.kinds import Role, of_role
from commonrail.notice import note as tell
from commonrail.observation.quantities import is_of_meter

__all__ = ["Fan", "near_fits", "scattered"]


MEMBERS = 16
TRIED = 128  # directions, of which the bounds and orders of a study may stop many at once
WORSE = 0.05  # share by which the objective of a member may exceed that of the best fit
SCATTER = 0.05  # of the parameters of a model of which nothing was fitted
SEED = 1
HALVINGS = 12  # of the distance at which the objective is to be met
FLOOR = 1e-3  # smallest share of the largest curvature: beyond it a direction is as good as free


@dataclass(frozen=True)
class Fan:
    """Members of a fan.

    Attributes
    ----------
    short, note : str
        Text of the legend, and a sentence that says what the members are.
    names : tuple of str
        Dotted names of the parameters in which they differ.
    members : (members, names)
        [SI].
    """

    short: str
    note: str
    names: tuple[str, ...]
    members: Floats


def scattered(names: tuple[str, ...], values: Floats, injector: Injector) -> Fan | None:
    """Parts whose parameters scatter about their values, at random.

    Parameters
    ----------
    names : tuple of str
    values : (names,)
        [SI].
    injector : Injector
        Its domains bound what may be drawn.
    """
    if not names:
        return None
    random = np.random.default_rng(SEED)
    members = values * (1.0 + random.uniform(-SCATTER, SCATTER, (MEMBERS, len(names))))
    inside = all(
        injector.quantities[name].domain.admits(column).all() for name, column in zip(names, members.T, strict=True)
    )
    if not inside:
        return None
    note = (
        f"Fan: {MEMBERS} parts whose parameters on sliders scatter by ±{SCATTER:.0%} about the file's values, evenly, "
        f"at random (seed {SEED}); an assumption, no measured scatter."
    )
    return Fan(f"±{SCATTER:.0%} scatter", note, names, members)


def near_fits(run: Path, study: Study, best: Mapping[str, float], threads: int | None = None) -> Fan | None:
    """Draws from the posterior of a run if it has one that may be used, else fits little worse than the best one.

    Parameters
    ----------
    run : Path
    study : Study
    best : mapping of str to float
        [SI].
    threads : int, optional

    Raises
    ------
    InputError
        If posterior.npz is damaged.
    """
    names = tuple(study.space.names)
    if (run / POSTERIOR).is_file():
        try:
            draws = read_posterior(run, names)
        except RefusedDrawsError as error:
            tell(f"{error} The page shows fits near the best one instead.")
        else:
            chosen = draws[np.linspace(0, len(draws) - 1, MEMBERS).astype(int)]
            note = f"Fan: {len(chosen)} draws of the {len(draws)} from the posterior of the run."
            return _of_injector(Fan("draws", note, names, chosen))
    found = _on_level(study, np.array([best[name] for name in names]), threads)
    if found is None:
        return None
    note = (
        f"Fan: {len(found)} fits whose objective on the fitted data is at most {WORSE:.0%} above that of the best fit, "
        f"the farthest in {TRIED} random directions of equal curvature (seed {SEED})."
    )
    return _of_injector(Fan(f"fits within {WORSE:.0%}", note, names, found))


def _of_injector(fan: Fan) -> Fan | None:
    """The same fan without the quantities of meters, which no simulated flow depends on."""
    own = [i for i, name in enumerate(fan.names) if not is_of_meter(name)]
    if not own:
        return None
    return Fan(fan.short, fan.note, tuple(fan.names[i] for i in own), fan.members[:, own])


def _on_level(study: Study, best: Floats, threads: int | None) -> Floats | None:
    """Fits (members, d) [SI] at or just below the level of the objective, None where the best cannot be simulated."""
    goal = Goal(study.loss, Priors.of(study.space.parameters), scale=study.loss_scale)
    fitted, space = of_role(study.data, Role.FIT), study.space
    objective = Objective(
        study.injector, space.names, fitted, study.time_step, threads, goal=goal, same_bits=study.same_bits
    )
    level = (1.0 + WORSE) * float(objective.costs(best[None]).costs[0])
    place = around(space, best)
    residuals = objective.residuals(place.values)
    if not (np.isfinite(level) and np.isfinite(residuals).all()):
        return None
    directions = _directions(place.slopes(residuals), np.random.default_rng(SEED))
    unit = space.to_unit(best)
    inside, outside = np.zeros(TRIED), np.ones(TRIED)
    for _ in range(HALVINGS):
        middle = 0.5 * (inside + outside)
        candidates = space.from_unit(np.clip(unit + middle[:, None] * directions, 0.0, 1.0))
        good = (objective.costs(candidates).costs <= level) & space.satisfies(candidates)
        inside, outside = np.where(good, middle, inside), np.where(good, outside, middle)
    farthest = np.sort(np.argsort(-inside, kind="stable")[:MEMBERS])
    return np.asarray(space.from_unit(np.clip(unit + inside[farthest, None] * directions[farthest], 0.0, 1.0)))


def _directions(slopes: Floats, random: np.random.Generator) -> Floats:
    """Random directions (tried, d) of equal curvature of the squares, the largest component of each being 1."""
    _, sizes, axes = np.linalg.svd(slopes, full_matrices=False)
    sizes = np.maximum(sizes, FLOOR * sizes[0])
    drawn = random.standard_normal((TRIED, len(sizes)))
    directions = (drawn / np.linalg.norm(drawn, axis=1, keepdims=True) / sizes) @ axes
    return np.asarray(directions / np.abs(directions).max(axis=1, keepdims=True))
