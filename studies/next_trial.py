"""Trial of `commonrail next`: three advised points against three of a regular grid, added to a sparse start.

Virtual injectors are drawn from the priors of ten parameters of the case cri2-16, the others being at their priors'
values, and measured at 8 x 12 operating points with noise of a share of the tolerance; on the measured map of that case
sparse starts of four points are drawn. Each start is fitted, three points are added in three ways (advised, and along
both diagonals of a regular grid of pressure and energising time), each is fitted, and the error is compared at the
points that none of them holds: against the measured quantity, for a virtual injector against the true one.

    python -m studies.next_trial [--benches 10] [--starts 10] [--criterion v] [--noise 0.3]
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import commonrail as cr
from commonrail.data.noise import Law
from commonrail.data.simulator import Simulator
from commonrail.plugins.certainty.estimate import estimate, library, starts_from
from commonrail.plugins.next.study import locate

Floats = NDArray[np.float64]

CASE = Path(__file__).parents[1] / "cases" / "cri2-16" / "study.toml"
SPARSE, ADDED, FREE = 4, 3, 10


def whole_map(study: cr.Study) -> cr.QuantityData:
    """All injected quantities of the case as one map."""
    sets = [one for one in study.data if isinstance(one, cr.QuantityData) and one.kind == cr.QuantityData.kind]
    points = tuple(p for one in sets for p, ok in zip(one.points, one.judged, strict=True) if ok)
    return of_points(sets[0], points, np.concatenate([one.quantity[one.judged] for one in sets]))


def of_points(like: cr.QuantityData, points: Sequence[cr.OperatingPoint], quantity: Floats) -> cr.QuantityData:
    """Map of plain quantities, its noise that of `like`."""
    none = np.zeros(len(points), bool)
    return replace(
        like,
        name="map",
        role=cr.data.Role.FIT,
        points=tuple(points),
        quantity=quantity,
        dead_time=none,
        sister=None,
        mass_density=float("nan"),
    )


def part_of(study: cr.Study, data: cr.QuantityData, rows: Sequence[int]) -> cr.Study:
    """Study of some rows of a map."""
    own = of_points(data, [data.points[i] for i in rows], data.quantity[list(rows)])
    return replace(study, data=(own,), conditions=())


def middle(parameter: cr.Parameter) -> float:
    """Value that the prior of a parameter is about [SI]; the middle of its bounds where there is none."""
    return parameter.prior.value if parameter.prior else 0.5 * (parameter.lower + parameter.upper)


def reduced(study: cr.Study) -> cr.Study:
    """The case with its first parameters free and the others at the values of their priors."""
    own = study.space.parameters
    rest = {p.name: middle(p) for p in own[FREE:]}
    space = cr.fit.Space(own[:FREE], ())
    return replace(study, injector=study.injector.with_values(rest), space=space, conditions=())


def fitted(study: cr.Study, begin: Floats) -> Floats:
    """Most likely values [SI] under data and prior, from a start in positions."""
    own = cr.fit.Likelihood.of(study, 1)
    if not np.isfinite(own.residuals(own.space.from_unit(begin[None]))).all():
        begin = starts_from(own, library(own, 64), 1)[0]
    return estimate(own, begin[None], rounds=1).point


def predicted(study: cr.Study, data: cr.QuantityData, point: Floats) -> Floats:
    """Quantities at all points of a map [m3]."""
    simulator = Simulator(study.injector, study.space.names, study.time_step, 1)
    return np.asarray(data.simulated(simulator, point[None])[0])


def prior_of(study: cr.Study) -> Floats:
    """Values that the priors are about [SI]."""
    return np.array([middle(p) for p in study.space.parameters])


def virtual(study: cr.Study, measured: cr.QuantityData, seed: int) -> tuple[cr.QuantityData, cr.QuantityData]:
    """Map of an injector drawn from the prior, as measured and without noise."""
    rng = np.random.default_rng(seed)
    places = np.array([locate(p)[:2] for p in measured.points])
    axes = [
        np.linspace(low, high, n) for low, high, n in zip(places.min(axis=0), places.max(axis=0), (8, 12), strict=True)
    ]
    points = [replace(measured.points[0], rail_pressure=p, energisings=t) for p in axes[0] for t in axes[1]]
    data = of_points(measured, points, np.zeros(96))
    while True:
        own = [rng.normal(middle(p), p.prior.sigma if p.prior else 0.0) for p in study.space.parameters]
        truth = np.clip(
            np.array(own), [p.lower for p in study.space.parameters], [p.upper for p in study.space.parameters]
        )
        if study.space.satisfies(truth[None])[0]:
            quantity = predicted(study, data, truth)
            if np.isfinite(quantity).all() and quantity.max() > 20e-9 and np.median(quantity) > 2e-9:
                noise = (
                    rng.standard_normal(96) * (measured.noise.sigma or 1.0) * (data.absolute + data.relative * quantity)
                )
                return replace(data, quantity=np.maximum(quantity + noise, 0.0)), replace(data, quantity=quantity)


def diagonals(data: cr.QuantityData, taken: Sequence[int]) -> list[list[int]]:
    """Free points nearest to both diagonals of a regular 3 x 3 grid."""
    places = np.array([locate(p)[:2] for p in data.points])
    scaled = (places - places.min(axis=0)) / np.ptp(places, axis=0)
    found = []
    for times in ((1 / 6, 1 / 2, 5 / 6), (5 / 6, 1 / 2, 1 / 6)):
        chosen: list[int] = []
        for target in zip((1 / 6, 1 / 2, 5 / 6), times, strict=True):
            apart = np.sum((scaled - target) ** 2, axis=1)
            apart[[*taken, *chosen]] = np.inf
            chosen.append(int(apart.argmin()))
        found.append(chosen)
    return found


def trial(
    study: cr.Study, maps: tuple[cr.QuantityData, cr.QuantityData], seed: int, settings: cr.design.DesignSettings
) -> dict[str, Any]:
    """Errors [tolerances, rms] before and after points were added in each way, to a map as measured and as true."""
    data, true = maps
    rng = np.random.default_rng(1000 + seed)
    start = rng.choice(len(data.points), SPARSE, replace=False).tolist()
    begin = np.clip(study.space.to_unit(prior_of(study)), 0.0, 1.0)
    sparse = part_of(study, data, start)
    before = fitted(sparse, begin)
    free = [i for i in range(len(data.points)) if i not in start]
    candidates = [cr.design.Candidate("quantities", data.points[i]) for i in free]
    best = dict(zip(study.space.names, before.tolist(), strict=True))
    plan = cr.design.next_measurements(sparse, best, candidates, settings, threads=1)
    advised = [free[candidates.index(one.candidate)] for one in plan.measurements]
    ways = {"advised": advised, **dict(zip(("rising", "falling"), diagonals(data, start), strict=True))}
    others = [i for i in free if all(i not in rows for rows in ways.values())]
    values = {"sparse": before}
    values |= {
        n: fitted(part_of(study, data, [*start, *rows]), study.space.to_unit(before)) for n, rows in ways.items()
    }
    every = np.array([true.errors(predicted(study, data, v))[others] for v in values.values()])
    sound = np.isfinite(every).all(axis=0)
    errors = dict(zip(values, every[:, sound], strict=True))
    found = {n: float(np.sqrt(np.mean(e**2))) for n, e in errors.items()}
    found |= {f"{n} median": float(np.median(np.abs(e))) for n, e in errors.items()}
    found["grid"] = float(np.sqrt(found["rising"] * found["falling"]))
    return found | {
        "gain": found["grid"] / found["advised"],
        "points": ways,
        "start": start,
        "failed": int(np.sum(~sound)),
    }


def main() -> None:
    """Run the trials and print one line of JSON for each, then the medians."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--benches", type=int, default=10)
    parser.add_argument("--starts", type=int, default=10)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--criterion", default="v", choices=["v", "d", "a"])
    parser.add_argument("--noise", type=float, default=0.3)
    given = parser.parse_args()
    study = reduced(cr.load_study(CASE))
    sigma = cr.Noise(sigma=given.noise, law=Law.GAUSSIAN)
    measured = whole_map(study).changed(noise=sigma)
    settings = cr.design.DesignSettings(points=ADDED, criterion=given.criterion)
    beds = [
        (bed, given.first + s) for bed, n in (("virtual", given.benches), ("CRI2-16", given.starts)) for s in range(n)
    ]
    found: dict[str, list[dict[str, Any]]] = {}
    for bed, seed in beds:
        begun = time.perf_counter()
        maps = (measured, measured) if bed == "CRI2-16" else virtual(study, measured, seed)
        one = trial(study, maps, seed, settings)
        found.setdefault(bed, []).append(one)
        print(
            json.dumps({"bed": bed, "seed": seed, "seconds": round(time.perf_counter() - begun, 1), **one}), flush=True
        )
    for bed, ones in found.items():
        middle = {
            k: round(float(np.median([one[k] for one in ones])), 3) for k in ("sparse", "advised", "grid", "gain")
        }
        print(json.dumps({"bed": bed, "n": len(ones), "wins": sum(one["gain"] > 1 for one in ones), **middle}))


if __name__ == "__main__":
    main()
