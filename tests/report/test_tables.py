"""Tables say what the record says, and the size of an error without colour."""

from __future__ import annotations

from typing import Any

import pytest

from commonrail.base.table import LARGE, MEDIUM, SMALL, Table
from commonrail.report.fit.tables import tables_of
from tests.report.samples import map_record, rate_record


def j_table(data: list[dict[str, Any]]) -> Table:
    return tables_of(data)[0]


def volume_table(data: list[dict[str, Any]]) -> Table:
    return tables_of(data)[1]


def figures_table(data: list[dict[str, Any]]) -> Table:
    return tables_of(data)[0]


def quantity_table(data: dict[str, Any]) -> Table:
    return tables_of([data])[1]


def dead_time_table(data: dict[str, Any]) -> Table:
    return tables_of([data])[2]


def column(table: Table, name: str) -> list[str]:
    """Texts of a column."""
    at = table.columns.index(name)
    return [row[at].text for row in table.rows]


def test_j_stands_by_label_in_the_order_rigid_start_calibrated() -> None:
    table = j_table(rate_record()["data"])
    assert [cell.text for cell in table.rows[0]] == [
        *("EVI 160 MPa", "fit", "931.4", "402.2", "171.5"),
        *("1.2", "160", "520"),
    ]


def test_a_model_that_was_not_run_has_no_column() -> None:
    data = rate_record()["data"]
    for d in data:
        del d["J"]["rigid"]
    assert "rigid body" not in j_table(data).columns


def test_a_failed_simulation_is_a_dash() -> None:
    data = rate_record()["data"]
    data[1]["J"]["best"] = None
    assert column(j_table(data), "calibrated") == ["171.5", "–", "158.4"]


def test_the_volume_error_is_relative_to_the_measured_volume() -> None:
    table = volume_table(rate_record()["data"])
    assert [cell.text for cell in table.rows[0][3:5]] == ["51.90", "+0.4"]  # 51.9/51.7 − 1


def test_a_quantity_table_has_every_quantity_and_no_dead_time() -> None:
    table = quantity_table(map_record()["data"][0])
    assert len(table.rows) == 14
    assert column(table, "measured")[0] == "0.24"


@pytest.mark.parametrize(
    ("measured", "best", "size"),
    [
        (50.0, 52.0, SMALL),  # 4 %
        (50.0, 47.0, MEDIUM),  # −6 %
        (50.0, 56.0, LARGE),  # 12 %
        (0.5, 0.59, SMALL),  # 18 %, but only 0.09 mm³
        (0.5, 0.70, MEDIUM),  # 0.2 mm³
        (0.5, 0.90, LARGE),  # 0.4 mm³
    ],
)
def test_the_size_of_an_error_is_relative_or_absolute(measured: float, best: float, size: str) -> None:
    data = map_record()["data"][1]
    data["rows"][0] |= {"measured": measured * 1e-9, "best": best * 1e-9}
    assert quantity_table(data).rows[0][-1].size == size


def test_sizes_can_be_told_apart_without_colour() -> None:
    cells = [row[-1] for row in quantity_table(map_record()["data"][0]).rows]
    signs = {cell.size: cell.plain[-1] for cell in cells}
    assert len(set(signs.values())) == len(signs) >= 2


def test_dead_times_are_in_microseconds() -> None:
    table = dead_time_table(map_record()["data"][0])
    assert [cell.text for cell in table.rows[1]] == ["160", "0.5", "228", "259.0", "224.0", "−4.0"]


def test_the_figures_of_a_map_stand_model_by_model() -> None:
    table = figures_table(map_record()["data"])
    assert "above 3 mm³, % rms" in table.columns
    assert [cell.text for cell in table.rows[1]] == ["map", "fit", "calibrated", "14", "4.83", "0.210", "4.0"]


def test_only_tables_with_rows_are_made() -> None:
    data = map_record()["data"]
    for d in data:
        d["rows"] = [row for row in d["rows"] if not row["dead_time"]]
    titles = [table.title for table in tables_of(data)]
    assert len(titles) == 3
    assert not any("Dead times" in title for title in titles)


def test_synthetic_values_are_not_called_measured() -> None:
    data = map_record()["data"][0] | {"synthetic": "Interpolated."}
    tables = [*tables_of([data]), volume_table(rate_record()["data"])]
    for table in tables:
        assert not any("measured" in text for text in (*table.columns, table.note))
    assert "synthetic" in tables[1].columns


def test_every_row_is_as_long_as_the_head() -> None:
    tables = tables_of(rate_record()["data"]) + tables_of(map_record()["data"])
    assert all(len(row) == len(table.columns) for table in tables for row in table.rows)
