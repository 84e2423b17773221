"""Run a sensitivity study: simulate a design, estimate indices or effects, and vary one parameter at a time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from commonrail.base.arguments import function, instance, instances, thread_count
from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError, SimulationError
from commonrail.base.record import Interval
from commonrail.calibration.objective import Goal, Objective
from commonrail.calibration.parameter import Parameter
from commonrail.calibration.space import Space
from commonrail.calibration.study import Study, fitted_data
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.status import OK
from commonrail.engine.time_step import DEFAULT_STEP, check_step
from commonrail.physics.injector import Injector
from commonrail.plugins.sensitivity.estimates import (
    Effects,
    Estimate,
    Indices,
    morris_effects,
    one_at_a_time,
    saltelli,
    sobol_indices,
    trajectories,
)
from commonrail.plugins.sensitivity.file import Effect, Failed, OutputSensitivity, Range, Sensitivity
from commonrail.plugins.sensitivity.settings import Design, OnFailure, SensitivitySettings
from commonrail.plugins.sensitivity.study import (
    DEFAULT_FEATURES,
    Codes,
    Computing,
    Evaluated,
    Features,
    Model,
    Output,
    join_models,
    misfit_model,
    read_features,
    reason,
)

AT_A_TIME = 16_384  # candidates evaluated together


class Progress(NamedTuple):
    """Number of finished candidates and total number."""

    done: int
    total: int


class _Design(NamedTuple):
    """Candidates of a design in the unit cube, block by block, and the shape of an output's values."""

    blocks: Iterator[Floats]
    shape: tuple[int, int]
    points: Floats  # trajectories of Morris; empty for Sobol'


def sensitivity(
    of: Injector | Study,
    parameters: Sequence[Parameter] | None = None,
    points: Sequence[OperatingPoint] = (),
    features: Sequence[str] = DEFAULT_FEATURES,
    *,
    settings: SensitivitySettings | None = None,
    threads: int | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> Sensitivity:
    """Estimate the sensitivity of injection features, and of J, to parameters.

    Parameters
    ----------
    of : Injector or Study
        A study adds its objective J to the outputs; its injector gives the fixed values.
    parameters : sequence of Parameter, optional
        Parameters with their ranges, uniform on their scale and independent, made by `parameters_within`; default:
        those in the study. Constraints of a study are not applied.
    points : sequence of OperatingPoint
        Operating points of the features; at least one for an injector.
    features : sequence of str
        Names, such as "quantity" and "opening_delay"; `commonrail catalogue features` lists them.
    settings : SensitivitySettings, optional
    threads : int, optional
        Default: all usable processors; the result does not depend on it.
    progress : function of Progress, optional

    Raises
    ------
    ConfigurationError
        If an argument is of the wrong type, or there is neither an operating point nor a study.
    SimulationError
        If a simulation failed and the policy refuses that, or the injector itself cannot be simulated.
    """
    instance(of, Injector | Study, "subject of the study")
    settings_read = (
        instance(settings, SensitivitySettings, "settings") if settings is not None else SensitivitySettings()
    )
    study = of if isinstance(of, Study) else None
    injector = of.injector if isinstance(of, Study) else of
    if parameters is None:
        if study is None:
            raise ConfigurationError(
                "The parameters of an injector are needed; commonrail.parameters_within makes them."
            )
        parameters = study.space.parameters
    space = Space(instances(parameters, Parameter, "parameters"))
    _check(space, injector, study)
    step = check_step(settings_read.time_step or (study and study.time_step) or DEFAULT_STEP)
    computing = Computing(step, thread_count(threads), settings_read.precision)
    models: list[Model] = [misfit_model(_objective(study, space, computing))] if study else []
    if instances(points, OperatingPoint, "points"):
        models.append(Features(injector, space.names, points, read_features(features), computing).model)
    if not models:
        raise ConfigurationError(
            "An injector has no data: give operating points (--rail-pressure and --energising-time; in Python: "
            "points), or a study or run folder."
        )
    synthetic = study.synthetic if study else injector.synthetic
    title = study.title if study else injector.title
    notes = (CONSTRAINTS,) if study and study.space.constrained else ()
    return study_of_model(
        join_models(models),
        space,
        Sensitivity(
            title, injector.name, synthetic, tuple(map(Range.of, space.parameters)), settings_read, notes=notes
        ),
        function(progress, "progress"),
    )


CONSTRAINTS = (
    "The constraints of the study are not applied: indices need parameters that vary independently, each over its "
    "whole range."
)


def _check(space: Space, injector: Injector, study: Study | None) -> None:
    free = study.space.names if study else ()
    for parameter in space.parameters:
        if parameter.name not in injector.values and parameter.name not in free:
            raise ConfigurationError(f"{injector.name} has no parameter {parameter.name}; correct its name.")


def _objective(study: Study, space: Space, computing: Computing) -> Objective:
    """J of the fitted data, without priors, which are not measured."""
    return Objective(
        study.injector,
        space.names,
        fitted_data(study),
        computing.time_step,
        computing.threads,
        computing.precision,
        goal=Goal(study.loss, conditions=study.conditions),
        same_bits=study.same_bits,
    )


def study_of_model(
    model: Model, space: Space, empty: Sensitivity, progress: Callable[[Progress], None] | None = None
) -> Sensitivity:
    """Compute the sensitivity of a model's outputs to parameters in the ranges of a space, into an empty result."""
    begin, settings = time.perf_counter(), empty.settings
    designing, resampling = (np.random.default_rng(s) for s in np.random.SeedSequence(settings.seed).spawn(2))
    design = _make_design(settings, space.dimension, designing)
    centre = space.to_unit(space.reference)
    cross = one_at_a_time(centre)
    total = design.shape[0] * design.shape[1] + len(cross)
    # exact reference values, without rounding by the unit cube
    about = model.evaluate(np.where(cross == centre, space.reference, space.from_unit(cross)))
    evaluated, away = _evaluate_design(
        model, space, design, lambda done: progress and progress(Progress(done + len(cross), total))
    )
    results = []
    for k, output in enumerate(model.outputs):
        failed = _count_failed(evaluated.codes[:, k], away[k], space)
        _refuse_failed(settings, output, failed)
        estimated: Indices | Effects | None = None
        if failed.share <= settings.most_failed:
            y = evaluated.values[:, k].reshape(design.shape)
            drawing = np.random.default_rng(resampling.integers(2**63)), settings.resamples, settings.confidence
            morris = settings.design is Design.MORRIS
            estimated = morris_effects(design.points, y, *drawing) if morris else sobol_indices(y, *drawing)
        ends = _ends(about.values[:, k], about.codes[:, k])
        results.append(_sensitivity(output, ends, failed, estimated, space.names, settings.most_failed))
    seconds = time.perf_counter() - begin
    return replace(empty, outputs=tuple(results), injections=total * model.injections, seconds=seconds)


def _make_design(settings: SensitivitySettings, dimension: int, rng: np.random.Generator) -> _Design:
    samples, each = settings.samples, dimension + (1 if settings.design is Design.MORRIS else 2)
    share = max(AT_A_TIME // each, 1)
    firsts = range(0, samples, share)
    if settings.design is Design.MORRIS:
        paths = trajectories(dimension, samples, rng)
        return _Design((paths[i : i + share].reshape(-1, dimension) for i in firsts), (samples, each), paths)
    a, b = saltelli(dimension, samples, rng)
    blocks = (_radial(a[i : i + share], b[i : i + share]) for i in firsts)
    return _Design(blocks, (samples, each), np.empty((0, 0, 0)))


def _radial(a: Floats, b: Floats) -> Floats:
    """A, AB_1 … AB_d and B of some base points, one base point after the other."""
    n, d = a.shape
    rows = np.repeat(a[:, None, :], d + 2, axis=1)
    rows[:, 1 + np.arange(d), np.arange(d)] = b
    rows[:, -1] = b
    return np.asarray(rows.reshape(n * (d + 2), d))


def _evaluate_design(
    model: Model, space: Space, design: _Design, report: Callable[[int], object]
) -> tuple[Evaluated, Floats]:
    """Outputs of all candidates; for each output the mean position of failed candidates minus the mean of all."""
    values, codes = [], []
    done = 0
    outputs, d = len(model.outputs), space.dimension
    failed, sums = np.zeros(outputs), np.zeros((outputs, d))
    everything = np.zeros(d)
    for cube in design.blocks:
        block = model.evaluate(space.from_unit(cube))
        lost = (block.codes != OK).astype(float)
        failed = failed + lost.sum(axis=0)
        sums = sums + lost.T @ cube
        everything = everything + cube.sum(axis=0)
        values.append(block.values)
        codes.append(block.codes)
        done += len(cube)
        report(done)
    away = np.divide(sums, failed[:, None], out=np.zeros_like(sums), where=failed[:, None] > 0.0)
    away = np.where(failed[:, None] > 0.0, away - everything / done, 0.0)
    return Evaluated(np.concatenate(values), np.concatenate(codes)), away


def _count_failed(codes: Codes, away: Floats, space: Space) -> Failed:
    kinds, counts = np.unique(codes[codes != OK], return_counts=True)
    reasons = {reason(int(kind)): int(count) for kind, count in zip(kinds, counts, strict=True)}
    total = int(counts.sum())
    most = int(np.argmax(np.abs(away)))
    where = "" if not total else f"{'high' if away[most] > 0.0 else 'low'} {space.names[most]}"
    return Failed(total, total / len(codes), reasons, where)


def _refuse_failed(settings: SensitivitySettings, output: Output, failed: Failed) -> None:
    if settings.on_failure is OnFailure.REFUSE and failed.number:
        why = max(failed.reasons, key=lambda text: failed.reasons[text])
        raise SimulationError(
            f"{failed.number} simulations have no {output.name}, most at {failed.where}, and the policy for failures "
            f"is to refuse: {why}"
        )


def _ends(values: Floats, codes: Codes) -> tuple[list[float | None], str]:
    """Outputs of `one_at_a_time`, None if a simulation or the reference failed, and the reasons of failures."""
    missing = " ".join(sorted({reason(int(code)) for code in codes[1:] if code != OK}))
    if codes[0] != OK:
        return [None] * len(codes), reason(int(codes[0]))
    return [None if code != OK else float(value) for value, code in zip(values, codes, strict=True)], missing


def _sensitivity(
    output: Output,
    ends: tuple[list[float | None], str],
    failed: Failed,
    estimated: Indices | Effects | None,
    names: Sequence[str],
    most_failed: float,
) -> OutputSensitivity:
    (base, *others), missing = ends
    why_not = ""
    if failed.share > most_failed:
        why_not = (
            f"{failed.share:.1%} of the simulations have no value, more than the limit of {most_failed:.0%}; "
            "narrow the ranges."
        )
    elif estimated is None:
        why_not = "The output is the same in all simulations, or too few of them have a value."
    effects = []
    for j, name in enumerate(names):
        low, high = others[j], others[len(names) + j]
        swing = None if low is None or high is None else high - low
        effects.append(Effect(name, low, high, swing, **_estimates(estimated, j)))
    return OutputSensitivity(
        output=output,
        base=base,
        missing=missing,
        failed=failed,
        estimated=estimated is not None,
        why_not=why_not,
        mean=estimated.mean if isinstance(estimated, Indices) else None,
        variance=estimated.variance if isinstance(estimated, Indices) else None,
        parameters=tuple(sorted(effects, key=lambda effect: -effect.rank)),
    )


def _estimates(estimated: Indices | Effects | None, j: int) -> dict[str, Any]:
    """Estimates of parameter j by field name of `Effect`."""

    def interval(estimate: Estimate) -> Interval:
        return Interval(*(float(values[j]) for values in estimate))

    if estimated is None:
        return {}
    used = int(estimated.used[j])
    if isinstance(estimated, Indices):
        return {"first": interval(estimated.first), "total": interval(estimated.total), "used": used}
    spread = float(estimated.spread[j])
    effect, magnitude = interval(estimated.mean), interval(estimated.magnitude)
    return {"effect": effect, "magnitude": magnitude, "spread": spread, "used": used}
