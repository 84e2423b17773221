"""The page of a comparison: complete, safe, and made again from its folder."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from commonrail.base.errors import InputError
from commonrail.plugins.compare.page import (
    comparison_commands,
    comparison_html,
    comparison_lines,
    comparison_tiles,
    difference_table,
)
from commonrail.report.page import write_report
from tests.plugins.compare.samples import NEW, OLD, STIFF, compared_maps, compared_rates, compared_traces, fail, typed
from tests.report.test_build import Page


def test_the_sentences_say_who_is_nearest_to_what() -> None:
    record = compared_rates()
    record["data"][2]["J"][OLD] = 1.0
    assert comparison_lines(typed(record)) == [
        f"“{NEW}” has the least J on EVI 160 MPa and EVI 120 MPa; “{OLD}” on EVI 80 MPa.",
        "3 models on 3 data sets; nothing was fitted.",
    ]


def test_maps_are_judged_by_their_large_quantities_and_failures_are_counted() -> None:
    record = compared_maps()
    fail(record, OLD, "No.")
    nearest, first, failed = comparison_lines(typed(record))
    assert re.findall(r"\d+", first) == ["2", "2"]
    assert NEW in nearest
    assert "map at 80 MPa" in nearest
    assert OLD not in nearest
    assert failed.startswith("2 ")


def test_the_first_screen_has_the_error_of_each_model_on_each_kind_of_data() -> None:
    record = compared_rates()
    for d, share in zip(record["data"], (0.01, 0.02, 0.123), strict=True):
        d["J_relative"][STIFF] = share
    tiles = {tile.head: tile.figure for tile in comparison_tiles(typed(record))}
    assert len(tiles) == 3
    assert tiles[f"error of {STIFF}"] == "12.3 %"
    maps = compared_maps()
    maps["data"] = maps["data"][:1]
    maps["data"][0]["figures"][OLD]["rms_large_percent"] = 4.56
    assert comparison_tiles(typed(maps))[0][:2] == (f"error of {OLD}", "4.6 %")


def test_the_command_line_is_quoted() -> None:
    commands = [command for _, command in comparison_commands(typed(compared_maps()), "a b")]
    assert commands == [
        f"commonrail compare {OLD}=runs/0 '{NEW}=runs/1' --data 'my study.toml' --out NEW-DIR",
        "commonrail report 'a b'",
    ]


def test_without_arguments_no_command_is_made_up() -> None:
    record = compared_maps()
    record["models"][0]["argument"] = ""
    assert [command for _, command in comparison_commands(typed(record), "a")] == ["commonrail report a"]


def test_tables_figures_models_and_data_are_there() -> None:
    record = compared_rates()
    page = Page(comparison_html(record, compared_traces(record)))
    assert page.count("div", **{"class": "drawing"}) == 3
    for words in (OLD, NEW, STIFF, "★ 171.5", "Injector 2", "bench, seed 1"):
        assert words in page.text.replace("\N{NO-BREAK SPACE}", " ")
    assert "Synthetic, not" in page.text
    assert difference_table(typed(record)).title in page.text


def folder_of(path: Path, record: dict[str, Any]) -> Path:
    """Folder with a record and no curves."""
    path.mkdir()
    (path / "comparison.json").write_text(json.dumps(record), encoding="utf-8")
    (path / "traces.csv").write_text("data,time [us],measured [mm3/ms]\n", encoding="utf-8")
    return path


def test_the_page_is_made_again_from_its_folder(tmp_path: Path) -> None:
    folder = folder_of(tmp_path / "a", compared_maps())
    page = Page(write_report(folder).read_text(encoding="utf-8"))
    assert f"commonrail report {folder}" in page.text


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"kind": "calibration"}, r"comparison\.json .*commonrail compare"),
        ({"schema": 2}, "version"),
        ({"models": [{}]}, r"comparison\.json"),
        ({"labels": {"x": "x"}, "data": [{"kind": "rate"}]}, r"comparison\.json"),
        ({"studies": [{}]}, r"comparison\.json"),
    ],
)
def test_a_record_that_cannot_be_read_says_why(tmp_path: Path, change: dict[str, Any], words: str) -> None:
    folder = folder_of(tmp_path / "a", compared_maps() | change)
    with pytest.raises(InputError, match=words):
        write_report(folder)


def test_a_missing_key_is_named(tmp_path: Path) -> None:
    record = compared_maps()
    del record["differences"]
    with pytest.raises(InputError, match='"differences"'):
        write_report(folder_of(tmp_path / "a", record))
