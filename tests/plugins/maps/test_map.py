"""The verb map: axes from the command line and from files, tables, JSON, files and the report."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import commonrail as cr
from commonrail.base.errors import InputError
from commonrail.cli.options import read_axis
from commonrail.plugins.maps.dcm import read_dcm
from commonrail.plugins.maps.verb import read_quantities
from tests.cli.conftest import Command

SMALL = ("--rail-pressure", "80,160MPa", "--quantity", "0,2,400mm3", "--energising-time", "200,400us", "--threads", "1")


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("20,40,80MPa", [20e6, 40e6, 80e6]),
        ("200bar, 40 MPa", [20e6, 40e6]),
        ("20:60:20MPa", [20e6, 40e6, 60e6]),
        ("0.1:0.3:0.1MPa", [0.1e6, 0.2e6, 0.3e6]),
    ],
)
def test_an_axis_is_a_list_or_a_range(text: str, values: list[float]) -> None:
    assert read_axis(text, "Pa", "--rail-pressure").tolist() == pytest.approx(values, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("20,40", "no unit"),
        ("20:40MPa", "FIRST:LAST:STEP"),
        ("40:20:5MPa", "a range"),
        ("20:40:0MPa", "a range"),
        ("0:100:0.001MPa", "at most 200"),
        ("a,b", '"b"'),
        ("20,40mm", "length"),
    ],
)
def test_an_axis_that_cannot_be_read_is_refused(text: str, word: str) -> None:
    with pytest.raises(InputError, match=word):
        read_axis(text, "Pa", "--rail-pressure")


@pytest.mark.parametrize("text", ["20:80:20degC", "20degC:80degC:20K", "293.15:353.15:20K", "20:80degC:20K"])
def test_the_step_of_temperatures_is_a_difference(text: str) -> None:
    """A step of 20 degC read as 293 K would leave the first value alone."""
    assert read_axis(text, "K", "--vary temperature").tolist() == pytest.approx([293.15, 313.15, 333.15, 353.15])


def test_quantities_by_mass_are_divided_by_the_density() -> None:
    assert read_quantities("1,2mg", 800.0, "--quantity").tolist() == pytest.approx([1e-6 / 800.0, 2e-6 / 800.0])
    assert read_quantities("1,2mm3", 800.0, "--quantity").tolist() == pytest.approx([1e-9, 2e-9])


def test_the_map_is_printed_and_written(command: Command, tmp_path: Path) -> None:
    dcm, csv, report = tmp_path / "et.dcm", tmp_path / "q.csv", tmp_path / "map.html"
    files = ("--out", dcm, "--quantity-out", csv, "--report", report, "--label", "InjVlv_tiET")
    done = command("map", "virtual-lino-2016", *SMALL, *files)
    assert done.status == 0, done.err
    assert "2 rail pressures × 3 quantities" in done.out
    assert "2 hold" in done.out
    (found,) = read_dcm(dcm)
    assert (found.label, found.values.shape, found.x.unit) == ("InjVlv_tiET", (3, 2), "hPa")
    assert "rail_pressure [MPa],energising_time [us],quantity [mm3],state" in csv.read_text(encoding="utf-8")
    page = report.read_text(encoding="utf-8")
    assert "Synthetic, not" in page
    assert page.count('class="drawing') == 6


def test_json_is_one_object_and_axes_come_from_a_file(command: Command, tmp_path: Path) -> None:
    dcm = tmp_path / "et.dcm"
    assert command("map", "virtual-lino-2016", *SMALL, "--out", dcm).status == 0
    done = command("map", "virtual-lino-2016", "--axes", dcm, "--energising-time", "300us", "--threads", "1", "--json")
    (found,) = done.record["maps"]
    assert found["rail_pressure"] == pytest.approx([80e6, 160e6])
    assert found["quantity"] == pytest.approx([0.0, 2e-9, 400e-9])
    assert found["inverse"]["state"][0][0] == "ZERO"


# Another program's: Latin-1, CRLF, masses on the x axis, times with one decimal, and a curve that is none of ours.
OF_AN_ECU = """* Kalibrierstand 7
KONSERVIERUNG_FORMAT 2.0

FESTKENNFELD InjVlv_tiET_MAP 3 2
   LANGNAME "Ansteuerdauer \xfcber Menge und Raildruck"
   EINHEIT_X "mg/Hub"
   EINHEIT_Y "bar"
   EINHEIT_W "ms"
   ST/X\t2.00\t5.25\t10.00
   ST/Y   800.0
   WERT   0.30000   0.40000   0.50000
   ST/Y   1600.0
   WERT   0.20000   0.30000   0.40000
END

KENNLINIE Other 2
   ST/X   1.0   2.0
   WERT   3.0   4.0
END
"""


def test_a_map_of_a_control_unit_comes_back_with_new_numbers_alone(command: Command, tmp_path: Path) -> None:
    source, out, csv = tmp_path / "ecu.dcm", tmp_path / "new.dcm", tmp_path / "new.csv"
    before = OF_AN_ECU.replace("\n", "\r\n").encode("latin-1")
    source.write_bytes(before)
    done = command("map", "virtual-lino-2016", "--axes", source, "--out", out, "--out", csv, "--threads", "1")
    assert done.status == 0, done.err
    after = out.read_bytes()
    lines = [line for line in after.split(b"\n") if line.endswith(b"\r") and b"WERT   0." not in line]
    assert lines == [line for line in before.split(b"\n") if line.endswith(b"\r") and b"WERT   0." not in line]
    assert b"reference density" in after
    assert len(re.findall(rb"\s0\.\d{5}\b", after)) == 6
    (found,) = read_dcm(out)
    injector = cr.load_injector("virtual-lino-2016")
    for pressure, row in zip((80e6, 160e6), found.values, strict=True):
        for mass, time in zip((2.0, 5.25, 10.0), row.tolist(), strict=True):
            solution = cr.simulate(injector, cr.OperatingPoint(pressure, time * 1e-3, 5e6, 0.5e6))
            # 0.01 mm³ of the search, and half of the last digit: 5 ns at some 50 mg/ms
            assert solution.injected_mass * 1e6 == pytest.approx(mass, abs=0.012)
    assert "quantity [mg/Hub],rail_pressure [bar],energising_time [ms],state" in csv.read_text(encoding="utf-8")


def test_two_models_are_compared_cell_by_cell(command: Command, tmp_path: Path) -> None:
    report = tmp_path / "two.html"
    done = command(
        "map", "virtual-lino-2016", "again=virtual-lino-2016", *SMALL, "--report", report, "--unreachable", "hold"
    )
    assert done.status == 0, done.err
    page = report.read_text(encoding="utf-8")
    assert "less virtual-lino-2016" in page


def test_a_measured_map_is_set_beside_the_model(command: Command, tmp_path: Path) -> None:
    data = tmp_path / "measured.csv"
    data.write_text("rail_pressure [MPa],energising_time [us],quantity [mm3]\n160,400,10\n80,300,1\n", encoding="utf-8")
    done = command("map", "virtual-lino-2016", *SMALL, "--measured", data, "--json")
    found = done.record["measured"]
    assert found["measured"] == pytest.approx([10e-9, 1e-9])
    assert found["rms_large"] == pytest.approx(abs(found["simulated"][0] / 10e-9 - 1.0))


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (("--label", "InjVlv_tiET"), "--label: without"),
        (("--label", "InjVlv_tiET", "--out", "et.csv"), "--label: without"),
        (("--quantity-label", "q", "--out", "et.dcm"), "--quantity-label: without"),
        (("--time-unit", "ms"), "--time-unit: without"),
        (("--label", "a b", "--out", "et.dcm"), '"a b"'),
        (("--pressure-unit", "mm", "--out", "et.dcm"), "cannot become"),
        (("--bands", "draws"), "--bands: virtual-lino-2016"),
        (("--measured", "nothing.csv"), "nothing.csv"),
        (("--axes", "nothing.dcm"), "nothing.dcm"),
        (("--axes", "et.dcm", "--rail-pressure", "80MPa"), "--rail-pressure: --axes et.dcm"),
        (("--axes", "et.dcm", "--out", "a.dcm", "--time-unit", "ms"), "--time-unit: --axes et.dcm"),
    ],
)
def test_options_are_checked_before_the_work(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...], word: str
) -> None:
    monkeypatch.chdir(tmp_path)
    done = command("map", "virtual-lino-2016", *options)
    assert done.status == 2, done.err
    assert word in done.sentence
    assert "simulating" not in done.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (("--out", "map.txt"), "map.txt: "),
        (("--unreachable", "empty", "--out", "et.dcm"), "2 of 6 cells"),
        (("--rail-pressure", "1MPa"), "pressure"),
        (
            ("--rail-pressure", "400,800,600bar"),
            "600 bar",
        ),
        (("--quantity", "2,1mg"), "--quantity: "),
        (
            ("--energising-time", "0.3,0.3ms"),
            "--energising-time: ",
        ),
    ],
)
def test_what_cannot_be_done_is_refused_with_one_sentence(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...], word: str
) -> None:
    monkeypatch.chdir(tmp_path)
    small = {name: value for name, value in zip(SMALL[::2], SMALL[1::2], strict=True) if name not in options}
    done = command("map", "virtual-lino-2016", *sum(small.items(), ()), *options)
    assert done.status == 2, done.err
    assert word in done.sentence
    assert list(tmp_path.iterdir()) == []
