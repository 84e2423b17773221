"""Meters in files: tables of a study, what is wrong with them in one sentence, and their way into calibrated.toml."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from commonrail.base.errors import CommonrailError, InputError
from commonrail.calibration.objective import Objective
from commonrail.calibration.optimisers.evolution import EvolutionSettings
from commonrail.calibration.parameter import Priors
from commonrail.calibration.result import result_record
from commonrail.calibration.run import calibrate
from commonrail.calibration.study import goal_of
from commonrail.calibration.study_file import load_study
from commonrail.physics.injector import Source
from commonrail.physics.meters import LowPass, Meter
from commonrail.readers.injector import load_injector, load_meters
from commonrail.readers.injector_writer import dump_injector
from commonrail.runs.fingerprint import hash_study
from tests.refused import refused

Edit = Callable[..., Path]

TABLE = """
[meters.bench]
law = "zero-phase"
order = 3
source = "data sheet"
mark = "M"
delay = { lower = "-5 us", upper = "20 us", start = "2 us" }
cutoff = { value = "9 kHz", source = "step response" }
gain = 1.02
"""
HEAD, ROLE = "[[data]]\n", 'role = "fit"\n'


@pytest.fixture
def metered(study_file: Edit) -> Edit:
    """Write the template's study with a table of meters, and name the meter in its data; returns its path."""

    def write(table: str = TABLE, name: str = "bench") -> Path:
        return study_file((HEAD, f'{table}\n{HEAD}meter = "{name}"\n'))

    return write


def test_a_meter_is_read_with_units_sources_and_bounds(metered: Edit) -> None:
    study = load_study(metered())
    (meter,) = study.meters
    assert (meter.name, meter.law, meter.order) == ("bench", LowPass.ZERO_PHASE, 3)
    assert meter.values == pytest.approx({"delay": 2e-6, "cutoff": 9e3, "gain": 1.02})
    assert meter.sources["cutoff"] == Source("M", "step response")
    assert meter.sources["gain"] == Source("M", "data sheet")
    delay = study.space.parameters[-1]
    assert (delay.name, delay.unit, delay.mark, delay.source) == ("meter.bench.delay", "s", "M", "data sheet")
    assert (delay.lower, delay.reference, delay.upper) == pytest.approx((-5e-6, 2e-6, 20e-6))


def test_a_start_that_is_left_out_is_neutral_or_in_the_middle(metered: Edit) -> None:
    table = '[meters.bench]\ndelay = { lower = "-1 us", upper = "9 us" }\ngain = { lower = 1.1, upper = 1.3 }\n'
    values = load_study(metered(table)).meters[0].values
    assert values == pytest.approx({"delay": 0.0, "gain": 1.2})


PRIOR = 'prior = { sigma = "3 us", source = "cable and recorder" }'


def test_a_prior_lies_about_the_start_unless_it_has_a_value(metered: Edit) -> None:
    for more, value in (("", 2e-6), ('value = "4 us", ', 4e-6)):
        prior = PRIOR.replace("{ ", "{ " + more)
        study = load_study(metered(TABLE.replace('start = "2 us" }', f'start = "2 us", {prior} }}')))
        delay = study.space.parameters[-1]
        assert delay.prior is not None
        assert (delay.prior.value, delay.prior.sigma) == pytest.approx((value, 3e-6))
        assert (delay.reference, delay.mark, delay.source) == (2e-6, "F", "cable and recorder")
        assert study.meters[0].sources["delay"] == Source("F", "cable and recorder")
        assert hash_study(study) != hash_study(load_study(metered()))
    without = TABLE.replace(', start = "2 us" }', f", {prior} }}")
    assert load_study(metered(without)).space.parameters[-1].reference == 4e-6


def test_the_prior_of_a_meter_is_part_of_objective_and_result(metered: Edit) -> None:
    study = load_study(metered(TABLE.replace('start = "2 us" }', f'start = "2 us", {PRIOR} }}')))
    names, goal = study.space.names, goal_of(study)
    values = np.array([study.space.reference, study.space.reference])
    values[1, -1] += 6e-6
    delay = study.space.parameters[-1]
    assert delay.prior is not None
    costs = [
        Objective(study.injector, names, study.data, study.time_step, 1, goal=one).costs(values).costs
        for one in (goal, goal._replace(priors=Priors()))
    ]
    assert costs[0] - costs[1] == pytest.approx([0.0, 4.0], rel=1e-9)  # two standard deviations, squared
    with_result = replace(study, method=replace(study.method, evolution=EvolutionSettings(4, 1), polish=0))
    found = calibrate(with_result, threads=1)
    record = result_record(found, {})["parameters"][-1]
    assert record["prior"] == {"value": 2e-6, "sigma": delay.prior.sigma, "source": "cable and recorder"}
    assert record["pull"] == pytest.approx((found.best["meter.bench.delay"] - 2e-6) / 3e-6)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "gain = 1.02",
            'gain = { value = 1.0, prior = { sigma = 0.1, source = "x" } }',
            ["meters.bench.gain", "fitted"],
        ),
        ('start = "2 us"', 'prior = { sigma = "0 us", source = "x" }', ["meters.bench.delay.prior", "sigma greater"]),
        ('start = "2 us"', 'prior = { sigma = "1 us" }', ["meters.bench.delay.prior.source", "missing"]),
        ('start = "2 us"', 'prior = { sigma = "1 kg", source = "x" }', ["meters.bench.delay.prior.sigma"]),
        (
            'start = "2 us"',
            'prior = { value = "1 ms", sigma = "1 us", source = "x" }',
            ["meters.bench.delay", "outside"],
        ),
        ("gain = 1.02", "gian = 1.02", ["meters.bench", "gian", "gain"]),
        ("gain = 1.02", "gain = -1.0", ["meters.bench.gain", "greater than zero"]),
        ("gain = 1.02", 'gain = "2 kg"', ["meters.bench.gain"]),
        ("gain = 1.02", "gain = { lower = 0.9 }", ["meters.bench.gain", "lower and upper"]),
        ("gain = 1.02", "gain = { value = 1.0, lower = 0.9, upper = 1.1 }", ["meters.bench.gain", "either a value"]),
        ("gain = 1.02", "gain = { lower = 1.1, upper = 0.9 }", ["meters.bench.gain", "exchange"]),
        ("gain = 1.02", "gain = { lower = 0.9, upper = 1.1, start = 2.0 }", ["meters.bench.gain", "between"]),
        ("gain = 1.02", "echo_share = 0.1\nquantity_offset = { lower = 0, upper = 1 }", ["quantity_offset"]),
        ('law = "zero-phase"', 'law = "bessel"', ["meters.bench.law", "zero-phase"]),
        ("order = 3", "order = 0", ["meters.bench.order"]),
        ("[meters.bench]", '[meters."two words"]', ["letters, digits"]),
        ("gain = 1.02", 'density = "830 kg/m3"\ntemperature = "40 degC"', ["density and a temperature"]),
    ],
)
def test_a_wrong_meter_is_told_with_file_and_key(metered: Edit, old: str, new: str, words: list[str]) -> None:
    path = metered(TABLE.replace(old, new), "two words" if "two words" in new else "bench")
    with pytest.raises(CommonrailError) as caught:
        load_study(path)
    text = str(caught.value)
    assert path.name in text
    assert "\n" not in text
    assert all(word in text for word in words), text


def test_a_meter_that_is_not_described_or_not_used_is_told(metered: Edit, study_file: Edit) -> None:
    with refused(InputError, "unknown-name data[1].meter"):
        load_study(metered(name="benhc"))
    unused = metered()
    unused.write_text(unused.read_text(encoding="utf-8").replace('meter = "bench"\n', ""), encoding="utf-8")
    with refused(InputError, "unused-meter meters"):
        load_study(unused)


def test_a_meter_makes_another_study(metered: Edit) -> None:
    texts = (TABLE, TABLE.replace("1.02", "1.03"), TABLE.replace("order = 3", "order = 2"))
    assert len({hash_study(load_study(metered(text))) for text in texts}) == 3


def test_meters_come_back_from_an_injector_file_bit_by_bit(tmp_path: Path) -> None:
    """They are no property of the injector, which is the same with and without them."""
    fitted = Source("F", 'calibrated by "a study"')
    meter = Meter("bench", {"delay": 5.3e-6 / 3.0, "gain": 1.02}, "cascade", 2, {"delay": fitted, "gain": fitted})
    injector, path = load_injector("virtual-lino-2016"), tmp_path / "calibrated.toml"
    dump_injector(injector, path, meters=[meter, Meter("scales", {"quantity_offset": 1e-10})])
    assert load_injector(path).values == injector.values
    first, second = load_meters(path)
    assert first == meter
    assert second.values == {"quantity_offset": 1e-10}
    dump_injector(injector, path)
    assert "meters" not in path.read_text(encoding="utf-8")
    assert load_meters(path) == ()


def test_bounds_of_a_meter_belong_in_a_study(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    dump_injector(load_injector("virtual-lino-2016"), path)
    with path.open("a", encoding="utf-8") as stream:
        stream.write('\n[meters.bench]\ndelay = { lower = "0 us", upper = "9 us" }\n')
    with refused(InputError, "bounds-given meters.bench.delay"):
        load_meters(path)
