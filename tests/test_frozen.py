"""The parts of a study are deeply immutable, always validated, hashable and can be pickled."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import commonrail as cr
from commonrail.base.arguments import FrozenDict

INJECTOR = cr.load_injector("virtual-lino-2016")
POINT = cr.OperatingPoint("160 MPa", "700 us")
TIMES = np.linspace(0.0, 1e-3, 5)


def curve() -> cr.RateData:
    meter = cr.Meter("bench", {"delay": "5 us"}, sources={"delay": cr.models.Source("M", "data sheet")})
    noise = cr.Noise(uncertain={"delay": "1 us"})
    return cr.RateData("curve", cr.data.Role.FIT, POINT, TIMES, np.full(4, 1e-6), 1.0, "", "", meter=meter, noise=noise)


def quantities() -> cr.QuantityData:
    return cr.QuantityData(
        "map", cr.data.Role.FIT, [POINT], [6e-8], 1e-9, 0.03, [False], 1.0, "", "", np.array([820.0])
    )


def study(data: Any) -> cr.Study:
    made = cr.study(INJECTOR, data, free={"valve.mass": "10 %", "valve.lift": "10 %"})
    return replace(made, files={Path("study.toml"): "0" * 64})


PLAN = cr.parts.TestPlan(
    "plan", [cr.parts.PlanTest("VL", 160e6, [(0.0, 700e-6)], nominal=6e-8, lower=5e-8, upper=7e-8)]
)
PLAN_DATA = cr.parts.PlanData.of(PLAN, INJECTOR, ("5 MPa", "0.5 MPa"), "plan", role=cr.data.Role.FIT)
OBJECTS: dict[str, Callable[[], Any]] = {
    "injector": lambda: cr.load_injector("cri2-16"),
    "fuel": lambda: cr.load_fuel("iso4113"),
    "truth": lambda: cr.lab.load_truth("virtual-lino-2016"),
    "curve": lambda: study(curve()),
    "map": lambda: study([quantities()]),
    "plan": lambda: PLAN,
    "plan data": lambda: study(PLAN_DATA),
    "trace": lambda: cr.features.RateTrace(TIMES, np.ones(4)),
    "axes": lambda: cr.maps.MapAxes.usual(160e6),
    "observer": lambda: cr.observer.ObserverSettings(deviations={"nozzle flow": 0.03}),
}


def open_parts(value: Any, path: str) -> Iterator[str]:
    """Paths of mappings, lists and arrays within a value that can be changed."""
    if isinstance(value, np.ndarray):
        yield from [path] if value.flags.writeable else []
    elif isinstance(value, list | set | Mapping) and not isinstance(value, FrozenDict):
        yield path
    elif isinstance(value, FrozenDict):
        for key, item in value.items():
            yield from open_parts(item, f"{path}[{key!r}]")
    elif isinstance(value, tuple):
        for i, item in enumerate(value):
            yield from open_parts(item, f"{path}[{i}]")
    elif is_dataclass(value):
        for f in fields(value):
            yield from open_parts(getattr(value, f.name), f"{path}.{f.name}")


@pytest.mark.parametrize("name", OBJECTS)
def test_nothing_within_can_be_changed(name: str) -> None:
    made = OBJECTS[name]()
    assert list(open_parts(made, name)) == []
    assert isinstance(hash(made), int)


@pytest.mark.parametrize("name", ["injector", "fuel", "truth", "plan"])
def test_equal_ones_have_one_hash_also_after_a_journey(name: str) -> None:
    made = OBJECTS[name]()
    for again in (OBJECTS[name](), pickle.loads(pickle.dumps(made)), copy.deepcopy(made), copy.copy(made)):
        assert again == made
        assert hash(again) == hash(made)
        assert list(open_parts(again, name)) == []


def test_values_of_an_injector_stay_those_of_its_parameters() -> None:
    made = cr.load_injector("virtual-lino-2016")
    holes = made.parameters.nozzle.holes
    for change in (
        lambda: made.values.__setitem__("nozzle.holes", -3.0),  # type: ignore[attr-defined]
        lambda: made.values.update({"nozzle.holes": -3.0}),  # type: ignore[attr-defined]
        lambda: made.values.pop("nozzle.holes"),  # type: ignore[attr-defined]
        lambda: made.sources.clear(),  # type: ignore[attr-defined]
    ):
        with pytest.raises(TypeError):
            change()
    assert made.values["nozzle.holes"] == holes


def test_what_was_passed_in_is_not_what_is_kept() -> None:
    values, rate = dict(INJECTOR.values), np.full(4, 1e-6)
    made, data = replace(INJECTOR, values=values), replace(curve(), rate=rate)
    values["nozzle.holes"], rate[0] = -3.0, -1.0
    assert made == INJECTOR
    assert data.rate.tolist() == [1e-6] * 4


@pytest.mark.parametrize(
    "make",
    [
        lambda: cr.Variant()._replace(body="nonsense"),
        lambda: cr.Variant()._replace(boundary="volume", actuation="direct"),
        lambda: cr.Variant._make(("rigid", "ideal", 3, "paper", "servo", "")),
        lambda: cr.Energising(0.0, 1e-3)._replace(duration=-5.0),
        lambda: cr.Energising._make((0.0, float("nan"))),
    ],
)
def test_no_way_leads_past_the_checks(make: Callable[[], object]) -> None:
    with pytest.raises(cr.errors.ConfigurationError):
        make()


def test_replaced_fields_are_read_as_arguments_are() -> None:
    assert cr.Variant()._replace(body="rigid") == cr.Variant("rigid")
    assert cr.Energising(0.0, 1e-3)._replace(duration="700 us") == cr.Energising(0.0, 700e-6)
