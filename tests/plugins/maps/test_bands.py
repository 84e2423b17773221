"""Bands about a map are those of `predict` at its cells, and the files and pages of a run's map hold them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import commonrail as cr
from commonrail.plugins.maps.axes import MapAxes
from commonrail.plugins.maps.response import Conditions
from commonrail.plugins.maps.run import InjectionMap, _tables, add_bands, injection_map
from commonrail.readers.grid import read_grid
from commonrail.readers.quantity_matrix import find_map
from commonrail.runs.folder import read_fit
from tests.cli.conftest import run_command
from tests.map_study import map_study

AXES = MapAxes(np.array([80e6, 120e6]), np.array([0.0, 2e-9, 6e-9, 900e-9]), np.array([300e-6, 500e-6]))
CONDITIONS = Conditions(0.5e6, 0.1e6, threads=1)
PLACES = [(p, t) for p in (60.0, 100.0, 140.0) for t in (400.0, 600.0, 900.0)]  # [MPa], [us]
SMALL = (
    *("--rail-pressure", "80,120MPa", "--quantity", "0,2,6,900mm3", "--energising-time", "300,500us"),
    *("--cylinder-pressure", "0.5MPa", "--return-pressure", "0.1MPa", "--threads", "1"),
)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Calibration of the map of a virtual injector, with a deviation of 1 % that changes its sign from row to row."""
    folder = tmp_path_factory.mktemp("map")
    points = [cr.OperatingPoint(p * 1e6, t * 1e-6, 0.5e6, 0.1e6) for p, t in PLACES]
    truth = cr.load_injector("cri2-16").with_values({"control_chamber.a_hole_diameter": 0.213e-3})
    quantities = 1e9 * cr.simulate_batch(truth, points, threads=1).injected_volume[0]
    lines = ["rail_pressure [MPa],energising_time [us],quantity [mm3]"]
    lines += [
        f"{p:g},{t:g},{q * (1.01, 0.99)[i % 2]:.5f}"
        for i, ((p, t), q) in enumerate(zip(PLACES, quantities, strict=True))
    ]
    (folder / "map.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (folder / "study.toml").write_text(map_study('absolute = "0.02 mm3"\nrelative = 0.02'), encoding="utf-8")
    done = run_command("calibrate", folder / "study.toml", "--out", folder / "run", "--threads", 1)
    assert done.status == 0, done.err
    return folder / "run"


@pytest.fixture(scope="module")
def found(run: Path) -> InjectionMap:
    return add_bands(injection_map(cr.load_injector(run / "calibrated.toml"), AXES, CONDITIONS), *read_fit(run))


def test_cells_have_the_bands_that_predict_gives_their_points(run: Path, found: InjectionMap) -> None:
    study, best = read_fit(run)
    cells = [(i, j) for i in range(2) for j in (1, 2)]  # of the inverse: quantities that are reached
    pairs = [(i, float(t)) for i in range(2) for t in AXES.energising_time]
    pairs += [(i, float(found.inverse.energising_time[i, j])) for i, j in cells]
    points = [cr.OperatingPoint(float(AXES.rail_pressure[i]), t, 0.5e6, 0.1e6) for i, t in pairs]
    (band,) = cr.predict(study, best, points, threads=1).bands
    assert found.bands is not None
    for level in (0.5, 0.9):
        for side in (0, 1):
            expected = band.edges[level][side]
            own = [*found.bands.quantity[level][side].ravel()]
            own += [found.bands.delivered[level][side][cell] for cell in cells]
            # the file of the injector has 12 digits, and other horizons add what is injected after closing: nothing
            np.testing.assert_allclose(own, expected, rtol=1e-7)


def test_cells_without_a_simulated_time_have_no_band(found: InjectionMap) -> None:
    assert found.bands is not None
    low, high = found.bands.delivered[0.9]
    assert np.isnan(low[:, [0, 3]]).all()  # the quantity 0, and one that is not reached
    assert (low[:, 1:3] < AXES.quantity[1:3]).all()
    assert (high[:, 1:3] > AXES.quantity[1:3]).all()
    narrow, wide = (np.subtract(*reversed(found.bands.quantity[level])) for level in (0.5, 0.9))
    assert (wide > 1.5 * narrow).all()  # of a normal distribution 2.4, more with few degrees of freedom


def test_no_edge_lies_below_what_can_be_injected() -> None:
    """Of 1 ± 2 mm³ and 5 ± 2 mm³, and of a model that returns fuel: its own value is then the edge."""
    volume, half = np.array([[1e-9, 5e-9, -1e-12]]), np.array([2e-9, 2e-9, 2e-9])
    low, high = _tables(volume, np.isfinite(volume), [-half, half])
    np.testing.assert_allclose(low, [[0.0, 3e-9, -1e-12]], rtol=1e-12)
    np.testing.assert_allclose(high, volume + half, rtol=1e-12)


def test_quantities_at_a_stated_density_have_bands_at_that_of_the_map(run: Path, found: InjectionMap) -> None:
    """A stated density only changes the volume that a mass has: bands in mass stay, but for the tolerance in mm³."""
    study, best = read_fit(run)
    assert found.bands is not None
    data = study.data[0]
    assert isinstance(data, cr.QuantityData)
    share = 0.5
    stated = replace(
        data,
        mass_density=share * found.density,
        quantity=data.quantity / share,
        absolute=data.absolute / share,
    )
    other = add_bands(replace(found, bands=None), replace(study, data=(stated,)), best)
    assert other.bands is not None
    # the reference density of the data is the map's within the rounding of twelve digits of the file
    for mine, its in zip(found.bands.quantity[0.9], other.bands.quantity[0.9], strict=True):
        np.testing.assert_allclose(its, mine, rtol=1e-6)


def test_another_injector_than_the_calibrated_one_has_no_bands(run: Path, found: InjectionMap) -> None:
    other = replace(found, injector=found.injector.with_values({"control_chamber.a_hole_diameter": 0.2e-3}))
    with pytest.raises(cr.errors.ConfigurationError, match=r"control_chamber\.a_hole_diameter"):
        add_bands(other, *read_fit(run))


def test_files_and_page_of_a_map_hold_the_bands(run: Path, tmp_path: Path) -> None:
    files = [tmp_path / f"et{ending}" for ending in (".csv", ".json", ".xlsx", ".mat", ".dcm")]
    page = tmp_path / "map.html"
    outs = [part for file in files for part in ("--out", file)]
    done = run_command("map", run, *SMALL, *outs, "--quantity-out", tmp_path / "q.csv", "--report", page, "--json")
    assert done.status == 0, done.err
    (record,) = done.record["maps"]
    edges = record["bands"]["delivered"][1]
    assert record["bands"]["levels"] == [0.5, 0.9]
    layers = {one["name"]: one for one in json.loads(files[1].read_text(encoding="utf-8"))["maps"][0]["layers"]}
    upper = layers["quantity_band_90_upper"]
    assert upper["unit"] == "mm3"
    assert upper["values"][2][1] == pytest.approx(1e9 * edges["upper"][1][2], abs=6e-4)  # three decimals
    assert upper["values"][3] == [None, None]
    rows = files[0].read_text(encoding="utf-8").splitlines()
    assert any("quantity_band_50_lower [mm3],quantity_band_50_upper [mm3]" in row for row in rows)
    text = page.read_text(encoding="utf-8")
    assert text.count("half width of the 90 % band") >= 2


def test_a_quantity_map_with_bands_is_read_back_as_data(run: Path, tmp_path: Path) -> None:
    file = tmp_path / "q.csv"
    assert run_command("map", run, *SMALL, "--quantity-out", file).status == 0
    read = find_map(read_grid(file))
    assert read.units == {"rail pressure": "MPa", "energising time": "us", "quantity": "mm3"}
    assert len(read.quantity) == 4


def test_bands_are_those_of_the_calibrated_injector_alone(run: Path) -> None:
    changed = ("--set", "nozzle.holes=7")
    done = run_command("map", run, *SMALL, *changed, "--json")
    assert done.record["maps"][0]["bands"] is None
    assert run_command("map", run, *SMALL, "--bands", "none", "--json").record["maps"][0]["bands"] is None
    refused = run_command("map", run, *SMALL, *changed, "--bands", "draws")
    assert refused.status == 2
    assert "--bands" in refused.sentence
