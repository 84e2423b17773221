"""The cases that ship with the project load, and hold the figures of their sources."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from commonrail.calibration.optimisers.staged import StagedSettings
from commonrail.calibration.study_file import load_study
from commonrail.data.base import Role
from commonrail.data.curves.data import RateData
from commonrail.data.quantities.data import QuantityData
from commonrail.data.quantities.returned import ReturnData
from commonrail.engine.operating_point import OperatingPoint, Trace
from commonrail.engine.simulate import simulate_batch
from commonrail.plugins.family.study import load_family
from commonrail.plugins.paper.bench import ENERGISING_TIME, bench_curve
from commonrail.plugins.paper.bench_file import load_truth
from commonrail.readers.injector import load_injector
from tools.make_fleet import QUANTITY_NOISE

CASES = Path(__file__).resolve().parents[3] / "cases"

# mm3/stroke, github.com/suertang/AI_ETMAP, commit b3a8019, map 165: rows by rail pressure, columns by energising time
ENERGISING_US = [250, 300, 400, 500, 700, 1000, 1400]
QUANTITY = {
    40: [0.24, 0.75, 2.05, 4.20, 10.97, 24.96, 45.12],
    80: [0.67, 2.32, 5.28, 10.47, 26.31, 51.76, 86.30],
    120: [1.00, 3.74, 9.24, 17.74, 40.00, 73.56, 118.98],
    160: [1.87, 5.83, 13.69, 26.06, 52.43, 92.76, 148.31],
}
DEAD_TIME_US = {40: 282, 80: 240, 120: 237, 160: 228}


def rows(data: QuantityData) -> list[tuple[int, int, float]]:
    """Rail pressure [MPa], energising time [us], quantity [mm3]."""
    return [
        (round(p.at_start(p.rail_pressure) / 1e6), round(p.pulses[0].duration * 1e6), round(q * 1e9, 6))
        for p, q in zip(data.points, data.quantity.tolist(), strict=True)
    ]


def expected(pressures: list[int]) -> list[tuple[int, int, float]]:
    table = [(p, t, q) for p in pressures for t, q in zip(ENERGISING_US, QUANTITY[p], strict=True)]
    return table + [(p, DEAD_TIME_US[p], 0.5) for p in pressures]


def test_real_injectors_map_is_that_of_its_source() -> None:
    fit, check, returned = load_study(CASES / "cri2-16" / "study.toml").data
    assert isinstance(fit, QuantityData)
    assert isinstance(check, QuantityData)
    assert (fit.role, rows(fit)) == (Role.FIT, expected([40, 80, 160]))
    assert (check.role, rows(check)) == (Role.VALIDATION, expected([120]))
    assert np.count_nonzero(fit.dead_time) == 3
    assert isinstance(returned, ReturnData)
    assert returned.source.startswith("specified")
    assert rows(returned) == [(135, 1000, 39.0), (160, 900, 42.0)]  # nominal values of two plans
    assert returned.stroke_period == 60e-3  # 1,000 strokes a minute


@pytest.mark.parametrize(
    "file",
    ["cri2-16/study.toml", "cri2-16/without-prior.toml", "family/164.toml", "family/165.toml", "paper/study.toml"],
)
def test_studies_of_cases_load(file: str) -> None:
    """The others wait for tables that are made: tests of their own load them."""
    assert load_study(CASES / file).space.names


# The same table of map 164, a sister part.
SISTER_QUANTITY = {
    40: [0.32, 0.84, 2.07, 4.08, 10.79, 24.71, 44.84],
    80: [0.73, 2.43, 5.20, 10.07, 25.87, 51.09, 85.41],
    120: [1.13, 4.08, 9.02, 17.76, 39.26, 72.39, 117.27],
    160: [2.70, 5.59, 13.65, 25.76, 51.38, 90.45, 146.59],
}
SISTER_DEAD_TIME_US = {40: 273, 80: 238, 120: 230, 160: 219}


def test_the_familys_maps_are_those_of_their_sources() -> None:
    family = load_family(CASES / "family" / "family.toml")
    sister = [(p, t, q) for p in (40, 80, 160) for t, q in zip(ENERGISING_US, SISTER_QUANTITY[p], strict=True)]
    sister += [(p, SISTER_DEAD_TIME_US[p], 0.5) for p in (40, 80, 160)]
    found = {name: study.data for name, study in family.parts.items()}
    for name, table in (("165", expected([40, 80, 160])), ("164", sister)):
        fit, check = found[name]
        assert isinstance(fit, QuantityData)
        assert (fit.role, check.role, rows(fit)) == (Role.FIT, Role.VALIDATION, table)
    values = [study.injector.values for study in family.parts.values()]
    assert [(v["nozzle.holes"], v["nozzle.hole_diameter"]) for v in values] == [(8, 0.1306e-3), (7, 0.1395e-3)]
    assert not any(study.synthetic for study in family.parts.values())
    # 37 of the type, seven distances from the common value and a flow for each part
    assert family.space.dimension == 37 + 2 * 7 + 2


def test_real_injectors_study_is_not_synthetic() -> None:
    study = load_study(CASES / "cri2-16" / "study.toml")
    assert study.synthetic == ""
    assert study.space.dimension == 39
    gaps = [p for p in study.space.parameters if p.name.endswith("_gap")]
    assert [p.prior is not None and "[E]" in p.source for p in gaps] == [True, True]
    others = [p for p in study.space.parameters if p not in gaps]
    assert all(p.prior is not None and p.mark == "F" and "map 164" in p.source for p in others)
    assert study.space.satisfies(study.space.reference)
    assert isinstance(study.method.evolution, StagedSettings)


def test_the_fleets_quantities_are_its_truths_with_the_noise_that_it_states() -> None:
    truth = read_records(CASES / "fleet" / "truth.csv")
    measured = read_records(CASES / "fleet" / "measurements.csv")
    injector = load_injector("virtual-lino-2016")
    deviations = []
    for row in truth:
        values = {key.partition(" ")[0]: float(value) for key, value in row.items() if key != "injector"}
        own = [m for m in measured if m["injector"] == row["injector"]]
        points = [OperatingPoint(p * 1e6, t * 1e-6) for p, t in ((float(m[PRESSURE]), float(m[TIME])) for m in own)]
        quantity = simulate_batch(injector.with_values(values), points).injected_volume[0] * 1e9
        deviations += [float(m[AMOUNT]) / q - 1.0 for m, q in zip(own, quantity.tolist(), strict=True)]
    assert len(deviations) == 72
    # 1 % of noise; the root mean square of 72 scatters by 1/sqrt(144) of it: three of these
    assert np.sqrt(np.mean(np.square(deviations))) == pytest.approx(QUANTITY_NOISE, rel=0.25)


PRESSURE, TIME, AMOUNT = "rail_pressure [MPa]", "energising_time [us]", "quantity [mm3]"


def read_records(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8") as stream:
        return list(csv.DictReader(line for line in stream if not line.startswith("#")))


def test_papers_study_is_the_papers() -> None:
    study = load_study(CASES / "paper" / "study.toml")
    assert [(d.name, d.role.value) for d in study.data] == [
        ("160 MPa", "fit"),
        ("120 MPa", "validation"),
        ("80 MPa", "validation"),
    ]
    assert (study.method.evolution.members, study.method.evolution.generations) == (50, 70)
    assert study.synthetic
    for data in study.data:
        assert isinstance(data, RateData)
        assert len(data.rate) == 520
        assert data.bounds[0] == pytest.approx(0.0, abs=1e-12)
        assert data.bounds[-1] == pytest.approx(1.56e-3, rel=1e-12)
        # a measured course about the pressure asked for: it falls with the injection and scatters by 0.3 MPa
        assert isinstance(data.point.rail_pressure, Trace)
        assert len(data.point.rail_pressure.value) == 520
        asked = float(data.name.removesuffix(" MPa")) * 1e6
        assert data.point.at_start(data.point.rail_pressure) == pytest.approx(asked, abs=1.5e6)


@pytest.mark.parametrize("rail", [160e6, 120e6, 80e6])
def test_papers_curves_are_those_of_the_bench(rail: float) -> None:
    """Files and code belong together: the default truth, seed 1."""
    truth = load_truth("virtual-lino-2016")
    curve = bench_curve(truth, load_injector(truth.injector), rail, ENERGISING_TIME, 1)
    (data,) = (d for d in load_study(CASES / "paper" / "study.toml").data if d.name == f"{rail * 1e-6:.0f} MPa")
    assert isinstance(data, RateData)
    assert isinstance(data.point.rail_pressure, Trace)
    # one step of the sensors: another processor may round the last bit, and the sensor then the other way
    np.testing.assert_allclose(data.rate, curve.rate, rtol=0, atol=1.01 * truth.rate_meter.resolution)
    np.testing.assert_allclose(data.point.rail_pressure.value, curve.rail, rtol=0, atol=1.01e4)


def test_papers_curves_say_that_they_are_synthetic() -> None:
    for rail in (160, 120, 80):
        text = (CASES / "paper" / "data" / f"evi_{rail}MPa.csv").read_text(encoding="utf-8")
        assert text.startswith("# SYNTHETIC")
        assert "# truth virtual-lino-2016 (" in text


def test_papers_bounds_and_ordering_hold_its_optimum() -> None:
    space = load_study(CASES / "paper" / "study.toml").space
    theoretical = np.array([1.22e8, 8.08e7, 8.21e7, 9.44e7, 9.43e7, 1.86e8, 5.82e7])  # Table 1
    optimal = np.array([3.03e8, 8.26e7, 8.35e7, 1.41e8, 1.05e8, 3.50e8, 6.44e7])
    assert space.names == tuple(f"plunger_needle.k{i}" for i in range(1, 8))
    # 1e-12: rounding of the percentages
    np.testing.assert_allclose(space.lower, 0.1 * theoretical, rtol=1e-12)
    np.testing.assert_allclose(space.upper, 3.0 * theoretical, rtol=1e-12)
    assert len(space.rows) == 6
    assert space.satisfies(np.array([theoretical, optimal])).all()
    assert not space.satisfies(optimal[[1, 0, 2, 3, 4, 5, 6]])
