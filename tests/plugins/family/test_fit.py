"""Joint fit of parts: known common values are found, and scattering ones have their two limits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

import commonrail as cr
from commonrail.calibration import scoring
from commonrail.plugins.family.drawn import FLOW
from commonrail.plugins.family.fit import FamilyFit, fit_family
from commonrail.plugins.family.study import Family, Share, Shared, joint_space
from tests.plugins.family.samples import INJECTOR, PRELOAD, injected, study_of

POINTS = (80.0, 400.0), (80.0, 900.0), (160.0, 300.0), (160.0, 900.0)
OWN = INJECTOR.values[PRELOAD]


def part(preload: float, flow: float = 1.0, *names: str) -> cr.Study:
    """Study of a part with known preload and flow relative to the injector's."""
    truth = INJECTOR.with_values({PRELOAD: preload * OWN, FLOW: flow**0.5 * INJECTOR.values[FLOW]})
    return study_of(truth, POINTS, *(names or (PRELOAD,)))


def fitted(parts: Mapping[str, cr.Study], shared: Mapping[str, Shared], starts: int = 1) -> FamilyFit:
    space, sharing = joint_space({name: study.space for name, study in parts.items()}, shared)
    settings = cr.fit.StagedSettings(
        members=16, generations=18, starts=starts, trial_iterations=0, finalists=starts, stage_iterations=6
    )
    return fit_family(Family("lino", "three parts", parts, space, sharing, shared, cr.fit.Method(settings), 1))


def test_the_common_value_and_each_parts_own_are_found() -> None:
    flows = {"a": 0.95, "b": 1.0, "c": 1.06}
    found = fitted(
        {name: part(1.1, flow, PRELOAD, FLOW) for name, flow in flows.items()}, {FLOW: Shared(Share.PER_PART)}
    )
    # noise-free data of the model itself: the descents stop at 1e-3 of the range, far below a residual of 1
    assert found.best[PRELOAD] == pytest.approx(1.1 * OWN, rel=2e-3)
    for name, flow in flows.items():
        own = found.parts[name]
        assert own.best[PRELOAD] == found.best[PRELOAD]
        assert (own.best[FLOW] / INJECTOR.values[FLOW]) ** 2 == pytest.approx(flow, rel=2e-3)
        assert own.injector.values[FLOW] == own.best[FLOW]
        assert own.scores[0].error < 0.2  # [%]
    known = found.injector_type.by_name
    assert set(known) == {PRELOAD}  # the flow is no property of the type
    assert known[PRELOAD].value == found.best[PRELOAD]
    assert [p.name for p in found.injector_type.parts] == ["a", "b", "c"]


def test_a_spread_towards_zero_is_a_common_value_and_a_wide_one_each_parts_own() -> None:
    parts = {"a": part(0.94), "b": part(1.06)}

    def preloads(shared: Shared) -> list[float]:
        found = fitted(parts, {PRELOAD: shared})
        return [found.parts[name].best[PRELOAD] / OWN for name in parts]

    common, own = preloads(Shared(Share.COMMON)), preloads(Shared(Share.PER_PART))
    narrow = preloads(Shared(Share.AROUND, 1e-6 * OWN))
    wide = preloads(Shared(Share.AROUND, OWN))
    assert common[0] == common[1]
    assert own == pytest.approx([0.94, 1.06], abs=2e-3)
    assert narrow == pytest.approx(common, abs=2e-3)
    assert wide == pytest.approx(own, abs=3e-3)
    between = preloads(Shared(Share.AROUND, 0.01 * OWN))
    assert own[0] < between[0] < between[1] < own[1]
    assert between[1] - between[0] < own[1] - own[0]


def test_the_mean_is_that_of_what_the_members_predict(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scoring, "WORST", 1e9)  # whatever the objectives of the descents are
    parts = {"a": part(0.94), "b": part(1.06)}
    found = fitted(parts, {}, starts=2)
    assert len(found.members) >= 2
    assert found.members == tuple(sorted(found.members))
    assert found.members[0] == found.cost
    for name, own in found.parts.items():
        (data,) = parts[name].data
        each = [cr.simulate_batch(injector, data.points, time_step=1e-6).injected_volume[0] for injector in own.members]
        assert own.mean[0].values == pytest.approx(np.mean(each, axis=0), rel=1e-12)
        expected = 100.0 * np.sqrt(np.mean((np.mean(each, axis=0) / data.quantity - 1.0) ** 2))
        assert own.mean[0].error == pytest.approx(expected, rel=1e-9)  # all points lie above 3 mm3
    assert fitted(parts, {}).parts["a"].mean == ()  # one descent has no others


def test_the_type_of_scattering_parts_has_their_spread() -> None:
    parts = {"a": part(0.94), "b": part(1.06)}
    around = fitted(parts, {PRELOAD: Shared(Share.AROUND, 0.05 * OWN)}).injector_type.by_name[PRELOAD]
    assert 0.05 * OWN <= around.spread < 0.10 * OWN
    assert around.between == 0.05 * OWN  # the rest is the error of the common value
    apart = fitted(parts, {PRELOAD: Shared(Share.PER_PART)}).injector_type.by_name[PRELOAD]
    # two exact values 12 % apart: their standard deviation, times sqrt(1 + 1/2)
    assert apart.spread == pytest.approx(0.12 * OWN / np.sqrt(2.0) * np.sqrt(1.5), rel=0.05)


def test_a_prior_of_a_common_parameter_counts_once() -> None:
    from commonrail.plugins.family.study import FamilyObjective

    studies = []
    for study in (part(1.0), part(1.0)):
        held = replace(study.space.parameters[0], prior=cr.Prior(OWN, 0.1 * OWN, "made up"))
        studies.append(replace(study, space=cr.fit.Space([held])))
    space, sharing = joint_space({"a": studies[0].space, "b": studies[1].space}, {})
    objective = FamilyObjective(studies, sharing, space)
    values = np.array([[OWN], [1.2 * OWN]])
    found = objective.costs(values)
    assert found.costs[0] == pytest.approx(0.0, abs=1e-12)
    residuals = objective.residuals(values)
    assert residuals.shape == (2, 2 * len(POINTS) + 1)
    assert found.costs == pytest.approx(np.sum(residuals**2, axis=1), rel=1e-12)
    assert residuals[1, -1] == pytest.approx(2.0)
    simulated: list[int] = []
    for own in objective.parts:
        own.costs = lambda few, own=own: simulated.append(len(few)) or type(own).costs(own, few)  # type: ignore
    again = objective.costs(np.repeat(values, 3, axis=0))
    assert simulated == [2, 2]  # a part's own candidates that are the same are simulated once
    assert again.simulations == 6 * 2 * len(POINTS)  # and count for each, however workers divide them
    assert again.costs.tolist() == np.repeat(found.costs, 3).tolist()


def test_constraints_of_each_part_hold_for_the_joint_points() -> None:
    names = ("control_chamber.z_hole_diameter", "control_chamber.a_hole_diameter")
    study = study_of(INJECTOR, POINTS[:1], *names)
    ordered = cr.fit.Space(study.space.parameters, (f"{names[0]} < {names[1]}",))
    space, sharing = joint_space({"a": ordered, "b": ordered}, {names[0]: Shared(Share.PER_PART)})
    z, a = (INJECTOR.values[name] for name in names)
    good, bad = dict.fromkeys(space.names, z), dict.fromkeys(space.names, z)
    good[names[1]] = bad[names[1]] = max(a, 1.01 * z)
    bad[f"{names[0]} of part b"] = 1.05 * good[names[1]]
    points = np.array([[values[name] for name in space.names] for values in (good, bad)])
    assert space.satisfies(points).tolist() == [True, False]
    assert sharing.of_part(0, points)[:, 0].tolist() == [z, z]


def test_a_relation_of_what_is_not_free_is_refused() -> None:
    space = part(1.0).space
    with pytest.raises(cr.errors.ConfigurationError, match=r"valve\.mass"):
        joint_space({"a": space, "b": space}, {"valve.mass": Shared(Share.PER_PART)})


def test_reference_quantities_of_a_fourth_part_need_only_its_flow() -> None:
    flows = {"a": 0.95, "b": 1.06}
    found = fitted(
        {name: part(1.1, flow, PRELOAD, FLOW) for name, flow in flows.items()}, {FLOW: Shared(Share.PER_PART)}
    )
    truth = INJECTOR.with_values({PRELOAD: 1.1 * OWN, FLOW: 1.03**0.5 * INJECTOR.values[FLOW]})
    adapted = cr.parts.adapt(found.injector_type, injected(truth, POINTS[1]), injector=INJECTOR)
    assert adapted.flow_factor == pytest.approx(1.03, rel=2e-3)
