"""Scores of models on data sets, and members of a fit: optima that fit equally well, and their mean prediction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from commonrail.base.choices import Body
from commonrail.base.errors import ConfigurationError
from commonrail.calibration.optimisers.base import Best
from commonrail.calibration.study import Study
from commonrail.data.base import DataSet, Score
from commonrail.data.metering import with_meters
from commonrail.data.quantities.data import QuantityData, QuantityScore
from commonrail.data.records import MEAN
from commonrail.data.simulator import Simulator
from commonrail.physics.injector import Injector
from commonrail.physics.meters import is_of_meter

Scores = tuple[Score, ...]


def scores_of(
    study: Study,
    calibrated: Injector,
    threads: int | None = None,
    with_rigid: bool = True,
    start: Scores | None = None,
    best: Mapping[str, float] | None = None,
) -> dict[str, Scores]:
    """Scores of all data sets with the start values, the calibrated values and, for curves, a rigid body.

    `start`: scores of the start values, if known. `best`: calibrated values; their meter values apply to the scores
    "best" alone. Start values and rigid body use the study's meters.
    """
    injectors = {"best": calibrated}
    traces = any(d.bounds is not None for d in study.data)  # the effect of the body shows only in curves
    if with_rigid and study.injector.variant.body is Body.FLEXIBLE and traces:
        rigid = study.injector.variant._replace(body=Body.RIGID)
        injectors["rigid"] = replace(study.injector, variant=rigid)
    start_scores = {"start": start or score_all(study, study.injector, threads)}
    data = {"best": with_meters(study.data, [meter.with_best(best or {}) for meter in study.meters])}
    return start_scores | {
        label: score_all(study, injector, threads, data.get(label)) for label, injector in injectors.items()
    }


def score_all(
    study: Study, injector: Injector, threads: int | None = None, data: Sequence[DataSet] | None = None
) -> tuple[Score, ...]:
    """Scores of the data sets, in order, for an injector with the study's time step and `same_bits`.

    `data`: data sets in place of the study's.
    """
    simulator = Simulator(injector, (), study.time_step, threads, same_bits=study.same_bits)
    return tuple(d.score(simulator) for d in (study.data if data is None else data))


def check_drive(injector: Injector, study: Study, label: str) -> None:
    """Refuse (`ConfigurationError`) an injector driven by a measured trace where the data hold no such trace.

    `label` is what messages call the injector.
    """
    drive = injector.variant.drive
    for data in study.data if drive.is_trace else ():
        if study.injector.variant.drive is not drive or any(point.drive is None for point in data.points):
            raise ConfigurationError(
                f'{label}: the injector is driven by a {drive.value}, and the data set "{data.name}" has none; '
                "take a variant with regulated or pwm drive, or data with that trace."
            )


# Members of a fit: optima of one search that fit equally well, and the mean of their predictions.
#
# If data leave many combinations of parameters open, such optima differ between the measured points, and the mean
# cancels part of their errors.

# Largest objective of a member relative to the best; the misfit is then 1.4 times as large. The mean needs several
# members; on the maps of the cases it predicts better than the best of them more often than not
# (cases/family/README.md).
WORST = 2.0


def members_of(ends: Sequence[Best]) -> list[Best]:
    """Optima, the best first, whose objective is at most `WORST` times the best objective."""
    return [end for end in ends if end.cost <= WORST * ends[0].cost]


def mean_of(data: Sequence[DataSet], scores: Sequence[Sequence[Score]]) -> tuple[Score, ...]:
    """Scores of the mean prediction of several models, from the scores of each model.

    Empty unless all data are maps and there are several models.
    """
    maps = [data_set for data_set in data if isinstance(data_set, QuantityData)]
    if len(maps) < len(data) or len(scores) < 2:
        return ()
    means = []
    for data_set, set_scores in zip(maps, zip(*scores, strict=True), strict=True):
        scored = [score for score in set_scores if isinstance(score, QuantityScore)]
        quantity = np.mean([score.values for score in scored], axis=0)
        means.append(QuantityScore(data_set, quantity, np.mean([score.dead_time for score in scored], axis=0)))
    return tuple(means)


def injector_of(study: Study, best: Mapping[str, float], number: int = 1) -> Injector:
    """Injector with the values of an optimum, the best being number 1; name and title say that it is calibrated."""
    values = {name: value for name, value in best.items() if not is_of_meter(name)}
    name = f"{study.injector.name}-calibrated" + (f"-{number}" if number > 1 else "")
    title = study.injector.title.removesuffix(", calibrated").removesuffix(", start values")
    return replace(study.injector.with_values(values), name=name, title=f"{title}, calibrated".removeprefix(", "))


def mean_scores(
    study: Study, calibrated: Injector, best: Scores, ends: Sequence[Best], threads: int | None
) -> tuple[tuple[Injector, ...], dict[str, Scores]]:
    """Injectors of the members, and the scores of their mean prediction; both empty if there is no mean.

    `calibrated` with the scores `best` is the first member.
    """
    if study.meters or any(not isinstance(data, QuantityData) for data in study.data):
        return (), {}
    injectors, scores = [calibrated], [best]
    for number, end in enumerate(members_of(ends)[1:], 2):
        injectors.append(injector_of(study, dict(zip(study.space.names, end.x.tolist(), strict=True)), number))
        scores.append(score_all(study, injectors[-1], threads))
    mean = mean_of(study.data, scores)
    return (tuple(injectors), {MEAN: mean}) if mean else ((), {})
