"""Rows of a map that a study holds out: they are validated and never fitted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from commonrail.base.errors import CommonrailError, ConfigurationError, InputError
from commonrail.calibration.objective import Objective
from commonrail.calibration.run import calibrate
from commonrail.calibration.study import Study
from commonrail.calibration.study_file import load_study
from commonrail.data.base import DataSet, Role
from commonrail.data.quantities.data import QuantityData
from commonrail.data.registry import of_role
from tests.map_study import map_study
from tests.refused import refused

TABLE = """rail_pressure [MPa],energising_time [us],quantity [mm3]
40,300,{}
40,700,{}
80,300,{}
80,700,{}
120,300,{}
120,700,{}
"""
QUANTITIES = (1.5, 11.0, 3.0, 26.0, 4.0, 40.0)
DEAD = "rail_pressure [MPa],energising_time [us]\n40,280\n80,240\n"
KEYS = 'dead_times = { file = "dead.csv", quantity = "0.5 mm3" }\n'

Load = Callable[..., Study]


@pytest.fixture
def load(tmp_path: Path) -> Load:
    """Study whose map holds rows out by some keys."""

    def run(keys: str = "", quantities: Sequence[float] = QUANTITIES, role: str = "fit") -> Study:
        (tmp_path / "map.csv").write_text(TABLE.format(*quantities), encoding="utf-8")
        (tmp_path / "dead.csv").write_text(DEAD, encoding="utf-8")
        (tmp_path / "study.toml").write_text(map_study(KEYS + keys, role), encoding="utf-8")
        return load_study(tmp_path / "study.toml")

    return run


def places(data: DataSet) -> list[tuple[float, float]]:
    """Rail pressure [MPa] and energising time [us] of the points."""
    return [(p.initial_pressures()[0] * 1e-6, round(p.pulses[0].duration * 1e6, 9)) for p in data.points]


def test_a_rail_pressure_is_held_out_with_its_dead_time(load: Load) -> None:
    fitted, held = load('hold_out = { rail_pressure = ["80 MPa"] }').data
    assert (fitted.name, fitted.role, held.name, held.role) == ("map", Role.FIT, "map, held out", Role.VALIDATION)
    assert places(fitted) == [(40.0, 300.0), (40.0, 700.0), (120.0, 300.0), (120.0, 700.0), (40.0, 280.0)]
    assert places(held) == [(80.0, 300.0), (80.0, 700.0), (80.0, 240.0)]
    assert isinstance(held, QuantityData)
    np.testing.assert_allclose(held.quantity, [3e-9, 26e-9, 0.5e-9], rtol=1e-15)


def test_an_energising_time_is_held_out_without_dead_times(load: Load) -> None:
    fitted, held = load('hold_out = { energising_time = ["0.3 ms"] }').data
    assert places(held) == [(40.0, 300.0), (80.0, 300.0), (120.0, 300.0)]
    assert isinstance(fitted, QuantityData)
    assert fitted.dead_time.sum() == 2


def test_what_is_at_either_is_held_out(load: Load) -> None:
    _, held = load('hold_out = { rail_pressure = ["40 MPa"], energising_time = ["700 us"] }').data
    assert places(held) == [(40.0, 300.0), (40.0, 700.0), (80.0, 700.0), (120.0, 700.0), (40.0, 280.0)]


def test_nothing_is_held_out_by_default(load: Load) -> None:
    (data,) = load().data
    assert len(data.points) == 8


def test_held_out_rows_have_no_part_in_the_objective(load: Load) -> None:
    keys = 'hold_out = { rail_pressure = ["120 MPa"], energising_time = ["700 us"] }'
    wild = (1.5, 900.0, 3.0, 0.001, 777.0, 5.0)  # of the same values where a row is fitted
    found = []
    for quantities in (QUANTITIES, wild):
        study = load(keys, quantities)
        objective = Objective(study.injector, study.space.names, of_role(study.data, Role.FIT), 1e-6, 1)
        found.append(objective.costs(np.array([[1.9e-4], [2.1e-4], [2.4e-4]])).costs)
    assert found[0].tobytes() == found[1].tobytes()
    assert len(set(found[0])) == 3


def test_the_same_fit_whatever_the_held_out_rows_are(load: Load) -> None:
    keys = 'hold_out = { rail_pressure = ["120 MPa"] }'
    first, second = (calibrate(load(keys, (*QUANTITIES[:4], *held)), threads=1) for held in ((4.0, 40.0), (0.1, 500.0)))
    assert first.best == second.best
    assert first.cost == second.cost
    assert first.scores["best"][1].error != second.scores["best"][1].error


@pytest.mark.parametrize(
    ("keys", "error", "words"),
    [
        ('hold_out = { rail_pressure = ["90 MPa"] }', ConfigurationError, ("90 MPa", "40 MPa, 80 MPa, 120 MPa")),
        ('hold_out = { energising_time = ["240 us"] }', ConfigurationError, ("240 us", "300 us, 700 us")),
        ("hold_out = {}", InputError, ("hold_out", "name rail pressures or energising times")),
        ('hold_out = { energising_time = ["300 us", "700 us"] }', ConfigurationError, ("leave some for the fit",)),
        ('hold_out = { pressure = ["40 MPa"] }', InputError, ("pressure",)),
    ],
)
def test_a_wrong_key_is_a_sentence(load: Load, keys: str, error: type[CommonrailError], words: tuple[str, ...]) -> None:
    with pytest.raises(error) as found:
        load(keys)
    assert all(word in str(found.value) for word in ("study.toml", *words))


def test_only_data_of_the_fit_are_held_out(load: Load) -> None:
    with refused(InputError, "not-of-fit data[1].hold_out"):
        load('hold_out = { rail_pressure = ["80 MPa"] }', role="validation")


def test_a_sister_part_is_read_from_its_file(load: Load, tmp_path: Path) -> None:
    (tmp_path / "sister.csv").write_text(TABLE.format(2, 12, 4, 27, 5, 41), encoding="utf-8")
    keys = 'sister = { file = "sister.csv", flow_ratio = 0.97 }\nhold_out = { rail_pressure = ["120 MPa"] }'
    _, held = load(keys).data
    assert isinstance(held, QuantityData)
    assert held.sister is not None
    assert held.sister.flow_ratio == 0.97
    np.testing.assert_allclose(held.sister.places[5], [120e6, 7e-4, 41e-9], rtol=1e-12)
    with refused(InputError, "out-of-range data[1].sister.flow_ratio"):
        load(keys.replace("0.97", "0"))
