"""Parts of commonrail-example, installed: pip install -e . && pytest."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import commonrail
from commonrail.base import registry
from commonrail.base.errors import InputError
from commonrail.calibration.optimisers.registry import find_optimiser
from commonrail.calibration.parameter import Parameter
from commonrail.calibration.space import Space
from commonrail.data.registry import find_kind
from commonrail.readers.columns import Column
from commonrail.readers.tables import read_columns

SPACE = Space([Parameter("valve.lift", 50e-6, 40e-6, 60e-6, "m", mark="E", source="made up")], ())


def test_all_parts_can_be_loaded() -> None:
    own = [entry for group in registry.GROUPS for entry in registry.find_installed(group).values()]
    assert {entry.name for entry in own if entry.load() is not None} >= {"random search", "jsonl", "spread"}


def test_the_search_approaches_a_minimum() -> None:
    found = find_optimiser("random search")
    assert found is not None
    search = found.begin(SPACE, np.random.default_rng(1), found.settings())
    while not search.finished:
        search.tell((search.ask().x[:, 0] / 50e-6 - 1.0) ** 2)
    assert search.best.cost < 1e-4


def test_columns_are_read_in_their_units(tmp_path: Path) -> None:
    file = tmp_path / "rate.jsonl"
    file.write_text("\n".join(map(json.dumps, [["time [us]", "rate [mm3/ms]"], [0, 1], [5, 2]])), encoding="utf-8")
    table = read_columns(file, [Column("time", "s", increasing=True), Column("rate", "m3/s")], least=2)
    assert table.columns["time"] == pytest.approx([0.0, 5e-6])
    assert table.columns["rate"] == pytest.approx([1e-6, 2e-6])
    file.write_text("no JSON", encoding="utf-8")
    with pytest.raises(InputError, match="expected lines"):
        read_columns(file, [Column("time", "s")])


def test_the_injector_runs_on_the_fuel_of_this_package() -> None:
    assert commonrail.load_injector("example-injector").fuel == commonrail.load_fuel("example-fuel")


def test_the_feature_is_found_in_a_trace() -> None:
    bounds = 1e-6 * np.arange(1001.0)
    rate = np.where((bounds[1:] > 300e-6) & (bounds[1:] <= 800e-6), 50e-6, 0.0)
    found = commonrail.features.find_features(
        commonrail.features.RateTrace(bounds, rate), [commonrail.Energising(0.0, "500 us")]
    )
    assert found.value("energised_rate") == pytest.approx(50e-6)


def test_the_nozzle_law_gives_both_engines_the_same_injection() -> None:
    plain = commonrail.load_injector("virtual-lino-2016")
    gradual = replace(plain, variant=plain.variant._replace(nozzle_law="gradual"))
    point = commonrail.OperatingPoint("120 MPa", "400 us")
    fast, reference = (commonrail.simulate(gradual, point, engine) for engine in ("lanes", "reference"))
    assert fast.injected_mass == pytest.approx(reference.injected_mass, rel=0.01)
    assert abs(fast.injected_mass / commonrail.simulate(plain, point).injected_mass - 1.0) > 0.01


def test_the_kind_of_data_is_known_by_its_name() -> None:
    kind = find_kind("supply quantities")
    assert kind is not None
    assert kind.what == "supply quantity"
