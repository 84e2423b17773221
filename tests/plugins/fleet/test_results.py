"""Tables and record of a fleet."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

import commonrail as cr
from commonrail.base.errors import OutputError
from commonrail.plugins.fleet.file import (
    Counts,
    Failure,
    RunClock,
    Spread,
    result_columns,
    summarise_fleet,
    summarise_spread,
    write_results,
)
from commonrail.plugins.fleet.journal import FAILED, Entry
from commonrail.plugins.fleet.page import fleet_warnings
from commonrail.plugins.fleet.run import FleetRun
from commonrail.plugins.fleet.run import fleet as run_fleet
from commonrail.plugins.fleet.study import load_fleet
from tests.plugins.fleet.conftest import COUNT, results, small_fleet
from tests.refused import refused

CLOCK = RunClock(seconds=2.0, first=1.0, calibrated_now=5, workers=1)


def test_a_row_for_each_injector_that_can_be_read_back_to_the_last_bit(whole: FleetRun) -> None:
    head, *rows = results(whole.folder)
    assert head[:6] == ["injector", "status", "reason", "J start", "J best", "J 160 MPa [mm3/ms]"]
    assert len(rows) == COUNT
    place = head.index("valve.spring_preload [N]")
    for row, entry in zip(rows, whole.entries, strict=True):
        own = entry.result.parameters["valve.spring_preload"]
        assert row[0] == entry.name
        assert float(row[4]) == entry.result.cost.best
        assert float(row[place]) == own.best
        assert row[place + 2] == own.verdict.value


def test_what_is_synthetic_is_said_in_each_file(whole: FleetRun) -> None:
    first = (whole.folder / "results.csv").read_text(encoding="utf-8").splitlines()[0]
    assert first.startswith("# SYNTHETIC: ")
    assert "not measured" in first
    assert whole.record["synthetic"] in first
    parquet = pytest.importorskip("pyarrow.parquet")
    assert b"SYNTHETIC" in parquet.read_schema(whole.folder / "results.parquet").metadata


def test_parquet_says_the_same(whole: FleetRun) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    table = parquet.read_table(whole.folder / "results.parquet")
    head, *rows = results(whole.folder)
    assert table.column_names[:-1] == head
    for i, name in enumerate(head):
        found = ["" if value is None else str(value) for value in table.column(name).to_pylist()]
        assert found == [row[i] for row in rows]


def test_without_pyarrow_there_is_csv(fleet_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    fleet = load_fleet(fleet_file)
    write_results(tmp_path, fleet, [], summarise_fleet(fleet, [], "interrupted", CLOCK))
    assert [row[1] for row in results(tmp_path)[1:]] == ["pending"] * COUNT
    assert not (tmp_path / "results.parquet").exists()


def test_a_failure_has_its_reason_and_no_numbers(fleet_file: Path, whole: FleetRun) -> None:
    entries = [Entry("SN000001", FAILED, "Because.", 1, {}, None, 0.1), *whole.entries[1:]]
    columns = result_columns(load_fleet(fleet_file), entries)
    assert columns["reason"][:2] == ["Because.", ""]
    assert columns["J best"][0] is None
    assert columns["valve.spring_preload [N]"][0] is None
    result = summarise_fleet(load_fleet(fleet_file), entries, "finished", CLOCK)
    assert result.failures == (Failure("SN000001", "Because."),)
    assert result.counts == Counts(injectors=COUNT, finished=COUNT - 1, failed=1, pending=0)


def test_the_record_on_disk_is_the_one_returned_and_all_time_is_under_one_key(whole: FleetRun) -> None:
    record = json.loads((whole.folder / "fleet.json").read_text(encoding="utf-8"), parse_constant=pytest.fail)
    assert record == whole.record
    del record["clock"]
    assert "second" not in json.dumps(record)


def test_the_spread_counts_only_numbers() -> None:
    expected = Spread(minimum=1.0, q1=2.0, median=3.0, q3=4.0, maximum=5.0, count=5)
    assert summarise_spread([5.0, None, 1.0, 2.0, 3.0, 4.0]) == expected
    assert summarise_spread([None]) is None


def test_the_worst_come_first(whole: FleetRun) -> None:
    costs = [w["J"]["best"] for w in whole.record["worst"]]
    assert costs == sorted((e.result.best_cost for e in whole.entries), reverse=True)


def test_the_speed_is_that_of_this_run(fleet_file: Path, whole: FleetRun) -> None:
    clock = summarise_fleet(load_fleet(fleet_file), whole.entries, "finished", CLOCK).clock
    assert clock.speed == 2.5
    assert clock.core_seconds == pytest.approx(sum(e.seconds for e in whole.entries), rel=1e-12)  # order of a sum


def test_a_file_that_cannot_be_written_leaves_the_old_one(
    fleet_file: Path, whole: FleetRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    (tmp_path / "results.csv").write_text("old", encoding="utf-8")
    monkeypatch.setattr("os.fsync", full)
    with refused(OutputError, "not-writable", "results.csv"):
        write_results(tmp_path, load_fleet(fleet_file), whole.entries, whole.result)
    assert [path.name for path in tmp_path.iterdir() if path.is_file()] == ["results.csv"]
    assert (tmp_path / "results.csv").read_text(encoding="utf-8") == "old"


def test_the_fleets_of_the_tests_give_no_warning(whole: FleetRun) -> None:
    assert whole.record["warnings"] == []
    head, *rows = results(whole.folder)
    assert [row[head.index("warnings")] for row in rows] == ["0"] * COUNT


@pytest.mark.process
@pytest.mark.usefixtures("forked_workers")
def test_an_injector_whose_data_are_upside_down_is_counted_and_told(fleet_file: Path, tmp_path: Path) -> None:
    data = fleet_file.parent / "data" / "SN000002_160MPa.csv"
    flipped = re.sub(r"(?m)^([\d.]+),([\d.])", r"\1,-\2", data.read_text(encoding="utf-8"))
    data.write_text(flipped, encoding="utf-8")
    run = run_fleet(load_fleet(fleet_file), tmp_path / "run", workers=1)
    head, *rows = results(tmp_path / "run")
    counts = {row[0]: int(row[head.index("warnings")]) for row in rows}
    assert {name: count > 0 for name, count in counts.items()} == {name: name == "SN000002" for name in counts}
    (told,) = (w for w in run.record["warnings"] if w["code"] == "sign")
    assert (told["injectors"], told["first"]) == (1, "SN000002")
    assert "mostly negative" in told["sentence"]
    line = fleet_warnings(run.result)[[w["code"] for w in run.record["warnings"]].index("sign")]
    assert line.startswith(f"1 of {COUNT} injectors: sign. The first, SN000002: 160 MPa: the rate")


def test_a_type_of_a_fleet_has_the_fixed_values_of_its_template(tmp_path: Path) -> None:
    file = small_fleet(tmp_path / "fleet")
    template = next(path for path in file.parent.glob("*.toml") if "[[parameter]]" in path.read_text(encoding="utf-8"))
    fixed = '[[fixed]]\nname = "valve.lift"\nvalue = "45 um"\nmark = "M"\nsource = "gauge"\n\n'
    text = template.read_text(encoding="utf-8").replace("[[parameter]]", fixed + "[[parameter]]", 1)
    template.write_text(text, encoding="utf-8")
    run_fleet(load_fleet(file), tmp_path / "run", workers=1)
    assert cr.parts.type_from_fleet(tmp_path / "run", "t").fixed == (
        cr.parts.FixedValue("valve.lift", 45e-6, "M", "gauge"),
    )
