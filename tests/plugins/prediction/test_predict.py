"""Bands of a map whose truth is known, at points that the fit has not seen."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import commonrail as cr
from commonrail.base.errors import ConfigurationError
from commonrail.calibration.study_file import load_study
from commonrail.data.noise import Law, Noise
from commonrail.data.simulator import Simulator
from commonrail.plugins.prediction.page import prediction_figures, prediction_html
from studies.coverage import BEDS, Benches
from tests.cli.conftest import Command, run_command
from tests.map_study import map_study

A_HOLE = 0.213e-3
PLACES = [(p, t) for p in (60.0, 100.0, 140.0) for t in (400.0, 600.0, 900.0)]  # [MPa], [us]
KEYS = 'absolute = "0.02 mm3"\nrelative = 0.02\nhold_out = { rail_pressure = ["100 MPa"] }'


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Study of a virtual map with noise of its tolerance, one rail pressure of which is held out."""
    folder = tmp_path_factory.mktemp("map")
    (folder / "study.toml").write_text(map_study(KEYS), encoding="utf-8")
    _write(folder, np.ones(len(PLACES)))
    empty = load_study(folder / "study.toml")
    simulator = Simulator(empty.injector, empty.space.names, empty.time_step, 1)
    fitted, held = (data.simulated(simulator, np.array([[A_HOLE]]))[0] for data in empty.data)
    quantities = 1e9 * np.concatenate([fitted[:3], held, fitted[3:]])
    noise = np.random.default_rng(2).standard_normal(len(PLACES))
    _write(folder, quantities + (0.02 + 0.02 * quantities) * noise)
    return folder / "study.toml"


def _write(folder: Path, quantities: np.ndarray) -> None:
    lines = ["rail_pressure [MPa],energising_time [us],quantity [mm3]"]
    lines += [f"{p:g},{t:g},{q:.6f}" for (p, t), q in zip(PLACES, quantities, strict=True)]
    (folder / "map.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


def test_points_have_the_bands_of_data_at_the_same_points(file: Path) -> None:
    study = load_study(file)
    best = {study.space.names[0]: A_HOLE}
    of_data = cr.predict(study, best, threads=1)
    held = next(band for band in of_data.bands if band.data.role is cr.data.Role.VALIDATION)
    asked = cr.predict(study, best, held.data.points, threads=1).bands[0]
    np.testing.assert_array_equal(asked.values, held.values)
    for level in of_data.levels:
        np.testing.assert_allclose(asked.edges[level], held.edges[level], rtol=1e-12)
    # the tolerance alone is exceeded, by what one parameter does of six noisy values: by less than half of it
    half = 0.5 * (held.edges[0.9][1] - held.edges[0.9][0])
    tolerance = 1.645 * (0.02e-9 + 0.02 * held.values)
    level = of_data.scatter["quantities"].factor
    assert (half > level * tolerance).all()
    assert (half < 1.5 * level * tolerance * 2.02 / 1.645).all()  # t of five degrees of freedom
    low, high = held.edges[0.9]
    inside = (held.data.measured >= low) & (held.data.measured <= high)  # noise of -2.4, 1.8 and 1.1 deviations
    assert held.covered(0.9) == np.count_nonzero(inside) == 1


def test_bands_beyond_the_fitted_times_are_wider_and_said_to_be(file: Path) -> None:
    study = load_study(file)
    best = {study.space.names[0]: A_HOLE}
    points = [cr.OperatingPoint(*place) for place in ((80e6, 500e-6), (80e6, 250e-6), (180e6, 500e-6))]
    assert "beyond" not in cr.predict(study, best, points[:1], threads=1).estimator
    found = cr.predict(study, best, points, threads=1)
    assert re.search(r"beyond .*energising times", found.estimator)
    band = found.bands[0]
    upper = (band.edges[0.9][1] - band.values) / (0.02e-9 + 0.02 * band.values)
    inner = cr.predict(study, best, [*points[:1], points[2]], threads=1).bands[0]
    same = (inner.edges[0.9][1] - inner.values) / (0.02e-9 + 0.02 * inner.values)
    np.testing.assert_allclose(upper[[0, 2]], same, rtol=1e-9)
    # twice the width of the scatter, which is in proportion to the tolerance; the parameter adds a little
    assert 1.8 < upper[1] / upper[0] < 2.6
    assert (band.edges[0.9][0] >= 0.0).all()


def test_the_report_draws_measured_values_within_their_bands(file: Path) -> None:
    study = load_study(file)
    found = cr.predict(study, {study.space.names[0]: A_HOLE}, threads=1)
    figures = prediction_figures(found)
    assert [figure.title for figure in figures] == [band.data.name for band in found.bands]
    for band, figure in zip(found.bands, figures, strict=True):
        (panel,) = figure.panels
        marked = [y for series in panel.series if series.mode == "markers" for y in series.y]
        assert sorted(marked) == pytest.approx(sorted(1e9 * band.data.measured))
        inside = 0
        for area, measured in zip(panel.bands, panel.series[::2], strict=True):
            ends = zip(area.low, measured.y, area.high, strict=True)
            inside += sum(low <= y <= high for low, y, high in ends)  # type: ignore[operator]
        assert inside == band.covered(0.9)
    page = prediction_html(found, study)
    assert all(f"{band.covered(0.9)} of {len(band.values)} measured values inside" in page for band in found.bands)


def test_draws_without_spread_leave_the_scatter_alone(file: Path) -> None:
    study = load_study(file)
    best = {study.space.names[0]: A_HOLE}
    found = cr.predict(study, best, draws=np.full((200, 1), A_HOLE), levels=[0.9], threads=1)
    band, scatter = found.bands[0], found.scatter["quantities"]
    half = 0.5 * (band.edges[0.9][1] - band.edges[0.9][0])
    quantile = 1.645 if np.isinf(scatter.freedom) else 2.02
    # quantiles of 1600 draws scatter by 4 %
    np.testing.assert_allclose(half, quantile * scatter.factor * (0.02e-9 + 0.02 * band.values), rtol=0.12)


def test_the_verb_predicts_points_and_counts_what_the_bands_hold(file: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    assert run_command("calibrate", file, "--out", run, "--threads", 1).status == 0
    counted = run_command("predict", run, "--threads", 1, "--json")
    assert counted.status == 0, counted.err
    assert [data["role"] for data in counted.record["data"]] == ["fit", "validation"]
    out = tmp_path / "bands.csv"
    asked = "--rail-pressure", "80MPa,120MPa", "--energising-time", "500us"
    done = run_command("predict", run, *asked, "--out", out, "--threads", 1)
    assert done.status == 0, done.err
    assert "Predicted quantities" in done.out
    lines = [line for line in out.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    assert len(lines) == 3
    assert lines[1].startswith("prediction,80,500,,,mm3,")
    half = run_command("predict", run, "--rail-pressure", "80MPa")
    assert (half.status, "both --rail-pressure" in half.sentence) == (2, True)
    plan = "next", run, "--points", 1, "--rail-pressure", "80MPa,120MPa", "--threads", 1
    planned = run_command(*plan, "--energising-time", "500us,800us")
    assert planned.status == 0, planned.err


def test_quantities_of_a_study_without_a_map_are_refused(tmp_path: Path) -> None:
    from commonrail.plugins.new.study import write_new

    write_new(tmp_path / "own")
    study = cr.load_study(tmp_path / "own" / "study.toml")
    best = {parameter.name: parameter.reference for parameter in study.space.parameters}
    with pytest.raises(ConfigurationError, match="quantity map"):
        cr.predict(study, best, [cr.OperatingPoint("100 MPa", "500 us")], threads=1)


def test_bands_of_a_curve_do_not_fall_below_what_flows() -> None:
    """Noise of ten times the rate: a linear band reached -8 mm³/ms before the needle opens."""
    benches = Benches(BEDS["white"])
    study, truth = benches.bench(1)
    best = dict(zip(study.space.names, truth.tolist(), strict=True))
    noisy = replace(study, data=(study.data[0].changed(noise=Noise(law=Law.GAUSSIAN, sigma=30e-6)),))
    (band,) = cr.predict(noisy, best, levels=[0.9], threads=1).bands
    low, high = band.alone[0.9]
    assert (low <= high).all()
    assert low.min() > -5e-7  # the fuel that flows back as the needle closes


def test_a_table_holds_no_dead_time_as_a_quantity() -> None:
    pytest.importorskip("pandas", reason="pandas comes with the extra notebook")
    study = load_study(Path(__file__).parents[3] / "cases" / "cri2-16" / "study.toml")
    table = cr.predict(study, {p.name: p.reference for p in study.space.parameters}).to_pandas()
    dead = np.concatenate([data.dead_time for data in study.data])
    assert dead.sum() == 4
    for name in ("predicted [mm3]", "measured [mm3]"):
        assert table[name][dead].isna().all()
        assert 0.0 < table[name][~dead].min() < table[name][~dead].max() < 200.0


def test_bands_and_report_at_one_place_are_refused(tmp_path: Path, command: Command) -> None:
    done = command("predict", tmp_path, "--out", tmp_path / "one.html", "--report", tmp_path / "one.html")
    assert done.status == 2
    assert "two outputs" in done.sentence
