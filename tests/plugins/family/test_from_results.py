"""Types from run folders and from the tables of a fleet."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

import commonrail as cr
from commonrail.base.csv_output import write_csv
from commonrail.base.output import write_set
from commonrail.runs.folder import write_record
from tests.plugins.family.samples import INJECTOR, MASS, PRELOAD

SOURCE = {"name": "map", "role": "fit", "source": "bench 3"}


def run_folder(path: Path, best: float, error: float | None, **more: Any) -> Path:
    """Run folder of a part whose valve preload [N] was fitted, its study made in Python."""
    path.mkdir()
    parameter = {"name": PRELOAD, "lower": 40.0, "upper": 100.0, "best": best, "standard_error": error, **more}
    record = {"schema": 1, "kind": "calibration", "title": path.name, "synthetic": "", "data": [SOURCE]}
    write_record(path / "result.json", {**record, "parameters": [parameter]})
    return path


def test_one_part_has_the_spread_of_its_prior(tmp_path: Path) -> None:
    prior = {"value": 60.0, "sigma": 5.0, "source": "drawing"}
    found = cr.parts.type_from_runs([run_folder(tmp_path / "a", 65.0, 2.0, prior=prior)], "t").by_name[PRELOAD]
    assert (found.value, found.spread, found.lower, found.upper, found.mark) == (65.0, 5.0, 40.0, 100.0, "F")
    assert "prior" in found.source


def test_one_part_without_a_prior_has_the_bounds_or_an_assumption(tmp_path: Path) -> None:
    folder = run_folder(tmp_path / "a", 65.0, 2.0)
    assert cr.parts.type_from_runs([folder], "t").by_name[PRELOAD].spread == pytest.approx(60.0 / math.sqrt(12.0))
    assumed = cr.parts.type_from_runs([folder], "t", part_spread=0.02).by_name[PRELOAD]
    assert assumed.spread == pytest.approx(math.hypot(2.0, 1.3))
    assert "2 %" in assumed.source


def test_a_length_spreads_by_no_more_than_its_machining_tolerance(tmp_path: Path) -> None:
    """IT7 of 3 to 6 mm is 12 um (ISO 286-1), where 3 % of 4.27 mm would be 128 um; 3 % of a lift of 42 um are less."""
    diameter, lift = "plunger_needle.plunger_diameter", "valve.lift"
    for name, value, spread in ((diameter, 4.27e-3, 12e-6), (lift, 42e-6, 1.26e-6)):
        folder = run_folder(tmp_path / name, value, 0.0, name=name, lower=0.5 * value, upper=2.0 * value)
        assert cr.parts.type_from_runs([folder], "t", part_spread=0.03).by_name[name].between == pytest.approx(
            spread, rel=0.03
        )


def test_several_parts_have_their_own_spread(tmp_path: Path) -> None:
    runs = [run_folder(tmp_path / name, best, 0.0) for name, best in (("a", 60.0), ("b", 64.0), ("c", 68.0))]
    found = cr.parts.type_from_runs(runs, "t")
    assert found.by_name[PRELOAD].value == pytest.approx(64.0)
    assert found.by_name[PRELOAD].spread == pytest.approx(4.0 * math.sqrt(1.0 + 1.0 / 3.0))
    assert [(part.name, part.source) for part in found.parts] == [(name, "bench 3") for name in "abc"]
    assert all(len(part.files["result.json"]) == 64 for part in found.parts)


def test_what_is_no_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(cr.errors.InputError, match=r"result\.json: "):
        cr.parts.type_from_runs([tmp_path], "t")
    other = run_folder(tmp_path / "b", 60.0, 1.0, name=MASS)
    with pytest.raises(cr.errors.InputError, match="free") as refused:
        cr.parts.type_from_runs([run_folder(tmp_path / "a", 60.0, 1.0), other], "t")
    assert str(refused.value).startswith(f"{tmp_path / 'a'}: ")


def fleet_folder(path: Path, *preloads: float) -> Path:
    """Folder of a fleet whose valve preloads [N] were fitted with errors of 1 N; the last injector failed."""
    path.mkdir()
    record: dict[str, Any]
    head = ["injector", "status", f"{PRELOAD} [N]", f"{PRELOAD} standard error [N]", f"{PRELOAD} verdict"]
    rows = [[f"SN{i}", "finished", repr(x), "1.0", "determined"] for i, x in enumerate(preloads)]
    rows.append(["SN", "failed", "", "", ""])
    with write_set(path):
        write_csv(path / "results.csv", ["SYNTHETIC: made up"], head, rows)
        parameter = {"name": PRELOAD, "lower": 40.0, "upper": 100.0, "prior": None}
        record = {
            "schema": 1,
            "kind": "fleet",
            "title": "line 4",
            "synthetic": "made up",
            "parameters": [parameter],
            "fixed": [],
        }
        write_record(path / "fleet.json", record)
    return path


def test_a_fleet_has_the_spread_over_its_members_beyond_their_errors(tmp_path: Path) -> None:
    found = cr.parts.type_from_fleet(fleet_folder(tmp_path / "f", 60.0, 64.0, 68.0), "t")
    preload = found.by_name[PRELOAD]
    assert preload.value == pytest.approx(64.0)
    assert preload.spread == pytest.approx(math.sqrt(16.0 - 1.0 + 16.0 / 3.0))
    assert (preload.lower, preload.upper) == (40.0, 100.0)
    assert (found.parts[0].name, found.parts[0].injectors, found.synthetic) == ("line 4", 3, "made up")


def test_a_fleet_needs_two_finished_injectors_and_its_own_table(tmp_path: Path) -> None:
    with pytest.raises(cr.errors.InputError, match=r"results\.csv: 1 "):
        cr.parts.type_from_fleet(fleet_folder(tmp_path / "f", 60.0), "t")
    folder = fleet_folder(tmp_path / "g", 60.0, 61.0)
    (folder / "results.csv").write_text((folder / "results.csv").read_text().replace("61.0", "62.0"))
    with pytest.raises(cr.errors.InputError, match=r"results\.csv"):
        cr.parts.type_from_fleet(folder, "t")


def test_a_type_of_a_fleet_fits_an_injector(tmp_path: Path) -> None:
    found = cr.parts.type_from_fleet(fleet_folder(tmp_path / "f", 60.0, 64.0, 68.0), "t")
    assert found.apply_to(INJECTOR).values[PRELOAD] == found.by_name[PRELOAD].value


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"schema": 2}, "another version of commonrail; fleet again"),
        (
            {"parameters": [{"name": PRELOAD}]},
            r"fleet\.json: parameters\[0\]\.lower: this key is missing; make it",
        ),
        ({"fixed": [{"name": PRELOAD, "value": 1.0, "mark": "X", "source": ""}]}, r'fixed\[0\]\.mark: "M" or .*"X"'),
    ],
)
def test_a_broken_record_of_a_fleet_is_refused(tmp_path: Path, change: dict[str, Any], words: str) -> None:
    folder = fleet_folder(tmp_path / "f", 60.0, 64.0, 68.0)
    record = json.loads((folder / "fleet.json").read_text(encoding="utf-8")) | change
    with write_set(folder):
        write_record(folder / "fleet.json", record)
    with pytest.raises(cr.errors.InputError, match=words):
        cr.parts.type_from_fleet(folder, "t")


def test_a_broken_record_of_a_part_is_refused(tmp_path: Path) -> None:
    folder = run_folder(tmp_path / "a", 65.0, 2.0, upper="x")
    words = r'result\.json: parameters\[0\]\.upper: a number was expected, and "x" was read; make it again'
    with pytest.raises(cr.errors.InputError, match=words):
        cr.parts.type_from_runs([folder], "t")
