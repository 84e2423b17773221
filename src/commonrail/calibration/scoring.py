"""Scores of a study's data sets under its start values, its calibrated ones, a rigid body or another injector."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from commonrail.base.choices import Body, Drive
from commonrail.base.errors import ConfigurationError
from commonrail.calibration.study import Study
from commonrail.data.base import DataSet, Score
from commonrail.data.metering import with_meters
from commonrail.data.simulator import Simulator
from commonrail.physics.injector import Injector

Scores = tuple[Score, ...]


def scores_of(
    study: Study,
    calibrated: Injector,
    threads: int | None = None,
    with_rigid: bool = True,
    start: Scores | None = None,
    best: Mapping[str, float] | None = None,
) -> dict[str, Scores]:
    """Every data set under the start values, the calibrated ones and, if it makes sense, a rigid body.

    `start` are the scores of the start values, if they are known. Of the calibrated values `best` those of meters count
    for "best"; start values and rigid body keep the study's meters.
    """
    injectors = {"best": calibrated}
    traces = any(d.bounds is not None for d in study.data)  # what a rigid body lacks is seen in a course in time
    if with_rigid and study.injector.variant.body is Body.FLEXIBLE and traces:
        rigid = study.injector.variant._replace(body=Body.RIGID)
        injectors["rigid"] = replace(study.injector, variant=rigid)
    known = {"start": start or score_all(study, study.injector, threads)}
    data = {"best": with_meters(study.data, [meter.with_best(best or {}) for meter in study.meters])}
    return known | {
        label: score_all(study, injector, threads, data.get(label)) for label, injector in injectors.items()
    }


def score_all(
    study: Study, injector: Injector, threads: int | None = None, data: Sequence[DataSet] | None = None
) -> tuple[Score, ...]:
    """Score of each data set, in their order, with the injector as it is and time step and `same_bits` of the study.

    `data` stand in place of the study's own.
    """
    simulator = Simulator(injector, (), study.time_step, threads, same_bits=study.same_bits)
    return tuple(d.score(simulator) for d in (study.data if data is None else data))


def check_drive(injector: Injector, study: Study, label: str) -> None:
    """Refuse (`ConfigurationError`) an injector driven by a measured trace where the data hold no such trace.

    `label` is what messages call the injector.
    """
    drive = injector.variant.drive
    for data in study.data if drive in (Drive.CURRENT, Drive.VOLTAGE) else ():
        if study.injector.variant.drive is not drive or any(point.drive is None for point in data.points):
            raise ConfigurationError(
                f'{label}: the injector is driven by a {drive.value}, and the data set "{data.name}" has none; '
                "take a variant with regulated or pwm drive, or data with that trace."
            )
