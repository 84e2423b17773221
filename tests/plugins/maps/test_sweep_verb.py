"""The verb sweep: variables, files, JSON, report, and the second injection held."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import commonrail as cr
from commonrail.plugins.maps.dcm import read_dcm
from commonrail.plugins.maps.ecu_file import read_ecu_maps
from tests.cli.conftest import Command

TWO = ("--first-energising-time", "300us", "--energising-time", "400us", "--rail-pressure", "160MPa", "--threads", "1")


def test_a_sweep_is_printed_and_written(command: Command, tmp_path: Path) -> None:
    csv, report = tmp_path / "dwell.csv", tmp_path / "dwell.html"
    done = command("sweep", "virtual-lino-2016", "--vary", "dwell=0,2000us", *TWO, "--out", csv, "--report", report)
    assert done.status == 0, done.err
    assert re.search(r"\b1 .*fused", done.out)
    assert "dwell, µs" in done.out
    lines = [line for line in csv.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    assert lines[0] == "dwell [us],quantity [mm3],second_quantity [mm3],fused"
    assert lines[1].endswith(",,yes")
    assert lines[2].endswith(",no")
    page = report.read_text(encoding="utf-8")
    assert page.count('class="drawing') == 2
    assert "Synthetic, not" in page
    facts = dict(re.findall(r"<dt>(.*)</dt><dd>(.*)</dd>", page))
    assert facts["Rail pressure"] == "160 MPa"
    assert facts["First energising time"] == "300 µs"
    assert facts["Fuel temperature"].endswith("°C")
    assert "Dwell" not in facts  # it is varied


def test_an_option_that_states_what_is_varied_is_refused(command: Command) -> None:
    done = command("sweep", "virtual-lino-2016", "--vary", "rail_pressure=80,120MPa", "--rail-pressure", "20MPa")
    assert done.status == 2
    assert re.search("--rail-pressure: .*--vary rail_pressure", done.err)


def test_a_sweep_of_parameters_and_temperature_as_json(command: Command) -> None:
    done = command(
        "sweep",
        "virtual-lino-2016",
        *("--vary", "temperature=20,40degC", "--vary", "nozzle.holes=6,7", "--vary", "rail_pressure=100,160MPa"),
        *("--threads", "1", "--json"),
    )
    record = done.record
    assert [v["name"] for v in record["variables"]] == ["fuel.temperature", "nozzle.holes", "rail_pressure"]
    assert record["variables"][0]["values"] == pytest.approx([293.15, 313.15])
    volumes = record["injected_volume"]
    assert volumes[0][0][0] < volumes[0][0][1]  # more at a higher pressure
    assert volumes[0][0][1] < volumes[0][1][1]  # and through more holes
    assert record["second_volume"] is None


def test_held_quantities_are_written_as_maps(command: Command, tmp_path: Path) -> None:
    dcm, csv, report = tmp_path / "second.dcm", tmp_path / "second.csv", tmp_path / "second.html"
    done = command(
        "sweep",
        "virtual-lino-2016",
        *("--vary", "dwell=1000,2000us", "--vary", "rail_pressure=100,160MPa", "--hold", "2,5mm3", *TWO[:4]),
        *("--longest", "600us", "--out", dcm, "--out", csv, "--report", report),
    )
    assert done.status == 0, done.err
    found = read_dcm(dcm)
    assert [m.label for m in found] == ["tiSecond_1000us", "tiSecond_2000us"]
    assert found[0].values.shape == (2, 2)
    assert len([line for line in csv.read_text(encoding="utf-8").splitlines() if line[0].isdigit()]) == 8
    assert "time at 160 MPa" in report.read_text(encoding="utf-8")


def test_dead_times_over_a_condition_are_one_map(command: Command, tmp_path: Path) -> None:
    """Absolute, and as a change against the model's own value, which is one of them."""
    dead, change, csv = tmp_path / "dead.dcm", tmp_path / "change.cdfx", tmp_path / "dead.csv"
    vary = ("--vary", "rail_pressure=100,160MPa", "--vary", "temperature=40,60,80degC", "--hold", "1mm3")
    files = ("--out", dead, "--out", csv)
    done = command("sweep", "virtual-lino-2016", *vary, "--longest", "500us", *files, "--json")
    assert done.status == 0, done.err
    assert command("sweep", "virtual-lino-2016", *vary, "--longest", "500us", "--change", "--out", change).status == 0
    (found,) = read_dcm(dead)
    assert (found.label, found.x.unit, found.y.unit, found.unit) == ("tiEnergising", "degC", "hPa", "us")
    assert found.x.values.tolist() == [40.0, 60.0, 80.0]
    assert found.values == pytest.approx(np.array(done.record["energising_time"])[:, :, 0].T * 1e6, abs=6e-4)
    (changed,) = read_ecu_maps(change).tables.values()
    own = cr.load_injector("virtual-lino-2016").values["fuel.temperature"] - 273.15
    assert changed.values[:, found.x.values.tolist().index(round(own))].tolist() == [0.0, 0.0]
    assert np.diff(changed.values, axis=1) == pytest.approx(np.diff(found.values, axis=1), abs=2e-3)
    assert "temperature [degC]" in csv.read_text(encoding="utf-8")


def test_the_change_over_dwell_and_pressure_is_one_map(command: Command, tmp_path: Path) -> None:
    """Of the quantity and of the energising time: one is that of the other sweep's numbers."""
    quantity, time, csv = tmp_path / "dq.dcm", tmp_path / "dt.dcm", tmp_path / "t.csv"
    vary = ("--vary", "dwell=1500,2500,3500us", "--vary", "rail_pressure=100,160MPa", *TWO[:4])
    label = ("--change", "--label", "InjWave")
    assert command("sweep", "virtual-lino-2016", *vary, *label, "--out", quantity).status == 0
    done = command("sweep", "virtual-lino-2016", *vary, "--json")
    second = np.array(done.record["second_volume"])
    alone = command("sweep", "virtual-lino-2016", *vary[2:4], *TWO[2:4], "--json").record["injected_volume"]
    (found,) = read_dcm(quantity)
    assert (found.label, found.x.unit, found.y.unit, found.unit) == ("InjWave", "us", "hPa", "mm^3/inj")
    assert found.values == pytest.approx((second - np.array(alone)).T * 1e9, abs=6e-4)  # three decimals
    held = ("--hold", "5mm3", "--longest", "600us")
    assert command("sweep", "virtual-lino-2016", *vary, *held, *label, "--out", time).status == 0
    assert command("sweep", "virtual-lino-2016", *vary, *held, "--out", csv).status == 0
    rows = [line.split(",") for line in csv.read_text(encoding="utf-8").splitlines() if line[0].isdigit()]
    differences = np.array([float(row[3]) - float(row[4]) for row in rows]).reshape(3, 2)
    (corrected,) = read_dcm(time)
    assert corrected.values == pytest.approx(differences.T, abs=6e-4)
    # More quantity where less time is needed, but for changes within what the search leaves, 0.01 mm³.
    clear = np.abs(found.values) > 0.05
    assert np.any(clear)
    assert np.all(np.sign(found.values[clear]) == -np.sign(corrected.values[clear]))


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (("--vary", "energising_time=1ms", "--out", "a.csv", "--change"), "--first-energising-time"),
        (("--vary", "energising_time=1ms", "--change"), "--change: without --out"),
        (("--vary", "dwell"), "NAME=VALUES"),
        (("--vary", "dwel=1ms"), '"dwel"'),
        (("--vary", "dwell=1,2ms"), "dwell"),
        (("--vary", "energising_time=1ms", "--out", "a.dcm"), "a.dcm: "),
        (
            ("--vary", "rail_pressure=80MPa", "--first-energising-time", "-5us"),
            "-5e-06 s",
        ),
        (("--vary", "temperature=20,392.85degC"), "defined from"),
        (("--vary", "energising_time=1ms", "--out", "-"), "or folder"),
        (("--vary", "energising_time=1ms", "--hold", "1mm3"), "rail_pressure and dwell"),
        ((*TWO[:2], "--vary", "temperature=80degC", "--hold", "1mm3"), "rail_pressure and"),
        (("--vary", "rail_pressure=100MPa", "--hold", "1mm3"), "rail_pressure and"),
        (("--vary", "energising_time=1ms", "--longest", "3ms"), "--longest: without --hold"),
        (("--vary", "energising_time=1ms", "--label", "ti"), "--label: without"),
    ],
)
def test_a_sweep_that_cannot_be_done_is_refused_with_one_sentence(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...], word: str
) -> None:
    monkeypatch.chdir(tmp_path)
    done = command("sweep", "virtual-lino-2016", *options)
    assert done.status == 2, done.err
    assert word in done.sentence


def test_no_output_takes_the_place_of_a_file_of_a_run(command: Command, study: Path, tmp_path: Path) -> None:
    """Results, the journal and copied data stay; an output of before beside them may be replaced."""
    run = tmp_path / "run"
    assert command("calibrate", study, "--out", run, "--threads", "1").status == 0
    before = {path: path.read_bytes() for path in run.rglob("*") if path.is_file()}
    line = ("sweep", "virtual-lino-2016", "--vary", "rail_pressure=80,160MPa", "--threads", "1")
    for path in (run / "traces.csv", run / "data" / "evi.csv"):
        done = command(*line, "--out", path)
        assert done.status == 2, done.err
        assert done.sentence == f"--out: {path} is a file of the run in {run}; name another file."
    done = command(*line, "--out", tmp_path / "s.csv", "--report", run / "report.html")
    assert (done.status, done.sentence[:8]) == (2, "--report")
    assert {path: path.read_bytes() for path in run.rglob("*") if path.is_file()} == before
    (run / "mine.csv").write_text("of before", encoding="utf-8")
    assert command(*line, "--out", run / "mine.csv").status == 0
