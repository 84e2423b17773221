"""Tables of a comparison: every model beside the others, the least error of each row marked."""

from __future__ import annotations

import pytest

from commonrail.base.table import Table
from commonrail.plugins.compare.page import comparison_tables, difference_table
from tests.plugins.compare.samples import NEW, OLD, STIFF, compared_maps, compared_rates, fail, typed


def table(tables: list[Table], start: str) -> Table:
    """The one table whose title starts so."""
    (found,) = (t for t in tables if t.title.startswith(start))
    return found


def texts(table: Table, row: int = 0) -> list[str]:
    """Texts of a row."""
    return [cell.text for cell in table.rows[row]]


def marked(table: Table, row: int = 0) -> list[str]:
    """Columns of a row that are marked as the least error."""
    return [name for name, cell in zip(table.columns, table.rows[row], strict=True) if cell.best]


def test_j_stands_in_the_order_of_the_labels_and_the_least_is_marked() -> None:
    found = table(comparison_tables(typed(compared_rates())), "Error J")
    assert found.columns == ("data set", "rail, MPa", OLD, NEW, STIFF, "samples")
    assert texts(found) == ["EVI 160 MPa", "160", "402.2", "171.5", "931.4", "520"]
    assert marked(found) == [NEW]
    assert found.rows[0][3].plain == "★\N{NO-BREAK SPACE}171.5"


def test_j_is_also_shown_relative_to_the_data() -> None:
    found = table(comparison_tables(typed(compared_rates())), "J relative")
    assert texts(found) == ["EVI 160 MPa", "160", "2.9", "1.2", "6.7"]  # of 14000, as samples.py makes it


def test_the_least_error_of_a_volume_is_the_nearest_not_the_lowest() -> None:
    found = table(comparison_tables(typed(compared_rates())), "Error of the injected volume")
    # 53.8, 51.9 and 38.2 against 51.7 mm³
    assert texts(found)[2:] == ["51.70", "+4.1", "+0.4", "−26.1"]
    assert marked(found) == [NEW]


@pytest.mark.parametrize(
    ("j", "best"), [((3.0, 3.0, 3.0), []), ((None, 3.0, None), []), ((3.01, 3.02, 9.0), [OLD, NEW])]
)
def test_what_reads_the_same_is_marked_alike(j: tuple[float | None, ...], best: list[str]) -> None:
    record = compared_rates()
    record["data"][0]["J"] = dict(zip((OLD, NEW, STIFF), j, strict=True))
    assert marked(table(comparison_tables(typed(record)), "Error J")) == best


def test_the_figures_of_a_map_are_marked_column_by_column() -> None:
    record = compared_maps()
    record["data"][0]["figures"][OLD]["rms_small"] = 0.1e-9
    found = table(comparison_tables(typed(record)), "Errors of the quantity maps")
    assert texts(found, 0) == ["map", OLD, "14", "22.40", "0.100", "31.0"]
    assert marked(found, 0) == ["up to 3 mm³, mm³ rms"]
    assert marked(found, 1) == ["above 3 mm³, % rms", "dead time, µs rms"]


def test_few_models_show_quantities_and_errors_many_only_errors() -> None:
    few = table(comparison_tables(typed(compared_maps())), "Quantities, mm³: map at 80 MPa")
    assert few.columns[2:] == ("measured, mm³", OLD, "error, %", NEW, "error, %")
    # 0.67 mm³; old 0.7 times as much, new 1.15 times as much and 0.1 mm³, as samples.py makes them
    assert texts(few) == ["80", "250", "0.67", "0.47", "−30.0", "0.87", "+29.9"]
    record = compared_maps()
    record["labels"] = {label: label for label in (OLD, NEW, "c", "d")}
    many = table(comparison_tables(typed(record)), "Errors of the quantities, %: map at 80 MPa")
    assert many.columns[2:] == ("measured, mm³", OLD, NEW, "c", "d")
    assert texts(many) == ["80", "250", "0.67", "−30.0", "+29.9", "–", "–"]


def test_dead_times_are_errors_in_microseconds() -> None:
    found = table(comparison_tables(typed(compared_maps())), "Errors of the dead times, µs: map at")
    assert texts(found) == ["80", "0.5", "240", "+31.0", "−4.0"]
    assert marked(found) == [NEW]


def test_points_without_a_number_are_gathered_by_reason() -> None:
    record = compared_maps()
    assert not any(t.title.startswith("Points without") for t in comparison_tables(typed(record)))
    fail(record, OLD, "The plunger-needle passed its seat.")
    found = table(comparison_tables(typed(record)), "Points without a number")
    assert [texts(found, i) for i in range(len(found.rows))] == [
        ["map", OLD, "40 MPa: 250, 300 µs", "The plunger-needle passed its seat.", "2"]
    ]
    quantities = comparison_tables(typed(record))[1]
    assert texts(quantities)[3:5] == ["–", "–"]


def test_parameters_that_differ_have_a_column_for_each_model() -> None:
    found = difference_table(typed(compared_maps()))
    assert found.columns == ("parameter", "meaning", OLD, NEW)
    assert texts(found) == ["needle_seat.diameter", "diameter of the seat", "2 mm", "3 mm"]
