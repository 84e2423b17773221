"""The verb features: traces of a file, repeated shots, and the curves of a run beside their simulation."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import Command, small_study
from tests.plugins.features.analytic import noisy, trapezoid

ENERGISED = ("--energising-time", "700us")


def wide(path: Path, shots: int, unit: str = "mm3/ms") -> Path:
    """Shots of one trapezoid with noise, a column each; the seventh has a tenth more."""
    traces = [noisy(trapezoid(end=1.5e-3), 0.001, seed) for seed in range(shots)]
    rates = np.array([(1.1 if i == 6 else 1.0) * trace.rate * 1e6 for i, trace in enumerate(traces)])
    header = ",".join(["time [us]", *(f"shot {i + 1} [{unit}]" for i in range(shots)), "pressure [MPa]"])
    rows = np.column_stack([1e6 * traces[0].bounds[1:], rates.T, np.full(rates.shape[1], 160.0)])
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.9g")
    return path


def test_features_of_one_trace_are_printed_written_and_given_as_json(command: Command, tmp_path: Path) -> None:
    out = tmp_path / "features.csv"
    done = command("features", wide(tmp_path / "trace.csv", 1), *ENERGISED, "--out", out)
    assert done.status == 0, done.err
    assert "opening_delay" in done.out
    assert "315." in done.out
    assert "threshold 5" in done.out
    (row,) = csv.DictReader(line for line in out.read_text(encoding="utf-8").splitlines() if not line.startswith("#"))
    assert float(row["opening_delay [us]"]) == pytest.approx(315.0, abs=0.5)
    assert row["status"] == "ok"
    (trace,) = command("features", tmp_path / "trace.csv", *ENERGISED, "--json").record["traces"]
    assert trace["injections"][0]["values"]["closing_delay"] == pytest.approx(290e-6, abs=0.5e-6)


def test_several_rates_are_shots_with_mean_scatter_and_one_that_stands_apart(command: Command, tmp_path: Path) -> None:
    file = wide(tmp_path / "shots.csv", 10)
    done = command("features", file, *ENERGISED)
    assert "Features of 10 shots" in done.out
    record = command("features", file, *ENERGISED, "--json").record
    (quantity,) = [one for one in record["shots"] if one["feature"] == "quantity"]
    assert (quantity["count"], quantity["outliers"]) == (10, [7])
    separate = command("features", file, *ENERGISED, "--separate", "--json").record
    assert "shots" not in separate
    assert len(separate["traces"]) == 10


def test_names_that_state_operating_points_are_no_shots_and_give_energising_times(
    command: Command, tmp_path: Path
) -> None:
    file = wide(tmp_path / "rates.csv", 2)
    text = file.read_text(encoding="utf-8").replace("shot 1", "500bar_300us").replace("shot 2", "900bar_700us")
    file.write_text(text, encoding="utf-8")
    record = command("features", file, "--json").record
    assert "shots" not in record
    delays = [trace["injections"][0]["values"]["closing_delay"] for trace in record["traces"]]
    assert delays == pytest.approx([690e-6, 290e-6], abs=1e-6)  # closing at 990 us, that of the trapezoid
    refused = command("features", file, *ENERGISED)
    assert refused.status == 2
    assert re.search('"500bar_300us" .*300 us.* 700 us', refused.sentence)


def test_a_binary_file_is_not_taken_for_a_text(command: Command, tmp_path: Path) -> None:
    file = tmp_path / "shots.mf4"
    file.write_bytes(b"MDF")
    refused = command("features", file)
    assert refused.status == 2
    assert "UTF-8" not in refused.sentence


def test_an_energising_without_an_injection_is_told(command: Command, tmp_path: Path) -> None:
    file = wide(tmp_path / "trace.csv", 1)
    pulses = ("--energising", "0us:700us", "--energising", "1100us:100us")
    assert "after energising 2." in command("features", file, *pulses).out
    nothing = command("features", file, *pulses, "--window", "1100us:1400us")
    assert nothing.status == 0
    assert "no injection" in nothing.out


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--rate", "flow"), '"flow"'),
        (("--threshold", "much"), "threshold"),
        (("--threshold", "2mg/ms"), "kg/s"),
        (("--window", "3ms"), "BEGIN:END"),
        (("--window", "5ms:6ms"), "0 samples"),
        (("--energising", "0us"), "START:DURATION"),
        (("--split", "150%"), "such as 50%, not 150%"),
        (("--split", "30"), "such as 30%, not 30"),
        (("--rate", "pressure"), "a unit like"),
    ],
)
def test_what_cannot_be_read_is_told_in_a_sentence(
    command: Command, tmp_path: Path, options: tuple[str, ...], words: str
) -> None:
    done = command("features", wide(tmp_path / "trace.csv", 1), *options)
    assert done.status == 2
    assert words in done.sentence


@pytest.mark.parametrize(
    "options",
    [
        ("--window", "0us:3000us"),
        ("--time", "t"),
        ("--time-unit", "s"),
        ("--rate", "flow"),
        ("--rate-unit", "mm3/ms"),
        ("--energising", "0us:700us"),
        ("--energising-time", "700us"),
        ("--centred",),
        ("--separate",),
    ],
)
def test_options_of_files_are_refused_for_a_run(command: Command, tmp_path: Path, options: tuple[str, ...]) -> None:
    done = command("features", tmp_path, *options)
    assert done.status == 2
    assert done.sentence == f"{tmp_path}: {options[0]} is for a file and does nothing for a run; omit {options[0]}."


def test_the_model_of_a_run_is_refused_for_a_file(command: Command, tmp_path: Path) -> None:
    done = command("features", wide(tmp_path / "trace.csv", 1), "--model", "rigid")
    assert done.status == 2
    assert "--model is for a run and does nothing for a file; omit --model." in done.sentence


def test_a_file_without_units_of_a_rate_asks_for_the_columns(command: Command, tmp_path: Path) -> None:
    file = tmp_path / "plain.csv"
    file.write_text("time [us],flow\n" + "".join(f"{i},0\n" for i in range(9)), encoding="utf-8")
    assert "plain.csv" in command("features", file).sentence
    done = command("features", file, "--rate", "flow", "--rate-unit", "mm3/ms")
    assert "no injection" in done.out


def test_a_narrow_terminal_keeps_the_values(command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("commonrail.cli.console.columns_of", lambda _: 40)
    assert re.search("feature +unit +mean", command("features", wide(tmp_path / "shots.csv", 10), *ENERGISED).out)


def test_a_run_shows_measured_and_simulated_features_and_their_difference(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, out = tmp_path / "run", tmp_path / "features.csv"
    assert command("calibrate", small_study(tmp_path / "small"), "--out", run, "--threads", "1").status == 0
    done = command("features", run, "--out", out)
    assert done.status == 0, done.err
    assert re.search("synthetic +simulated +difference", done.out)
    (data,) = command("features", run, "--json").record["data"]
    pair = [data[key]["injections"][0]["values"]["opening_delay"] for key in ("measured", "simulated")]
    assert 0.0 < pair[0] < 700e-6
    assert abs(pair[1] - pair[0]) < 50e-6
    assert data["measured"]["threshold"] == data["simulated"]["threshold"]
    rows = csv.DictReader(line for line in out.read_text(encoding="utf-8").splitlines() if not line.startswith("#"))
    delay = next(row for row in rows if row["feature"] == "opening_delay")
    assert float(delay["difference"]) == pytest.approx(1e6 * (pair[1] - pair[0]), abs=1e-6)
    assert '"other"' in command("features", run, "--model", "other").sentence
    assert command("features", run, "--energising-time", "1ms").status == 2
    monkeypatch.setattr("commonrail.cli.console.columns_of", lambda _: 40)
    assert re.search("feature +synthetic +simulated\n", command("features", run).out)


def test_features_of_a_run_that_was_fitted_to_features(command: Command, tmp_path: Path) -> None:
    study = small_study(tmp_path / "small")
    text = study.read_text(encoding="utf-8").replace('kind = "rate"', 'kind = "features"')
    delay, quantity = (("opening_delay", "2 us"), ("quantity", "1 mm3"))
    items = (f'{{ feature = "{name}", tolerance = "{tolerance}" }}' for name, tolerance in (delay, quantity))
    keys = f"features = [{', '.join(items)}]\n"
    study.write_text(text.replace("source = ", keys + "source = ", 1), encoding="utf-8")
    run = tmp_path / "run"
    done = command("calibrate", study, "--out", run, "--threads", "1", "--full")
    assert done.status == 0, done.err
    assert "Features of 160 MPa (fit), 160 MPa" in done.out
    assert "opening_delay 1" in (run / "report.html").read_text(encoding="utf-8")
    (fitted,) = json.loads((run / "result.json").read_text(encoding="utf-8"))["data"]
    for label in ("best", "start"):
        (shown,) = command("features", run, "--model", label, "--json").record["data"]
        values = shown["simulated"]["injections"][0]["values"]
        for row in fitted["rows"]:
            # the record and the verb simulate the same injector in the same steps
            assert values[row["feature"]] == pytest.approx(row[label], rel=1e-9)


def test_rates_of_parquet_and_mdf_are_found_by_their_units(command: Command, tmp_path: Path) -> None:
    pyarrow = pytest.importorskip("pyarrow", reason="the extra fleet is not installed")
    from pyarrow import parquet

    time = np.arange(300) * 5.0
    rate = np.interp(time, [270.0, 320.0, 600.0, 640.0], [0.0, 30.0, 30.0, 0.0])
    columns = {"time [us]": time, "shot [mm3/ms]": rate}
    parquet.write_table(pyarrow.table(columns), tmp_path / "a.parquet")
    rows = zip(*columns.values(), strict=True)
    text = "\n".join([",".join(columns), *(f"{float(t)!r},{float(r)!r}" for t, r in rows)])
    (tmp_path / "a.csv").write_text(text, encoding="utf-8")
    found = [json.loads(command("features", tmp_path / name, "--json").out) for name in ("a.parquet", "a.csv")]
    assert found[0] == found[1]
    asammdf = pytest.importorskip("asammdf", reason="the extra mdf is not installed")
    record = asammdf.MDF()
    record.append([asammdf.Signal(rate, time * 1e-6, "mm3/ms", "shot")])
    record.save(tmp_path / "a.mf4", overwrite=True)
    record.close()
    done = command("features", tmp_path / "a.mf4")
    assert done.status == 0, done.err
    assert "Features of shot" in done.out


def test_the_form_of_a_text_is_stated(command: Command, tmp_path: Path) -> None:
    plain = tmp_path / "plain.csv"
    german = tmp_path / "german.csv"
    lines = ["time [µs];rate [mm3/ms]"]
    lines += [f"{t};{30.5 if 300 < t <= 600 else 0.0}" for t in range(0, 1500, 5)]
    plain.write_text("\n".join(lines), encoding="utf-8")
    german.write_bytes("\n".join(lines).replace(".", ",").encode("cp1252"))
    stated = ("--encoding", "cp1252", "--decimal", ",")
    expected = command("features", plain, "--json")
    assert expected.status == 0, expected.err
    assert command("features", german, *stated, "--json").out == expected.out
    assert command("features", german, "--json").out == expected.out
    for options, words in (
        (("--decimal", "x"), "decimal"),
        (("--encoding", "utf-99"), "utf-99"),
    ):
        refused = command("features", german, *options)
        assert refused.status == 2
        assert words in refused.sentence
