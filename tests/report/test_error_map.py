"""Heat maps of the errors of a quantity map."""

from __future__ import annotations

import pytest

from commonrail.report.fit.figures import error_maps
from tests.report.samples import map_record, rate_record


def test_errors_are_in_percent_above_the_limit_and_in_volumes_below() -> None:
    large, small = error_maps(map_record()["data"])
    assert (large.unit, small.unit) == ("%", "mm³")
    assert large.y == small.y == ("40", "160")
    assert large.x == ("300", "400", "500", "700", "1000", "1400")  # no quantity above 3 mm³ at 250 µs
    row = dict(zip(large.x, large.values[0], strict=True))
    assert row["300"] is None
    assert row["700"] == pytest.approx(100.0 * (0.15 / 5.0 + 0.1 / 10.97))  # the sample's error at its fifth row
    assert small.x == ("250", "300", "400")  # up to 3 mm³: each quantity is in one of the two maps
    assert small.values[0][0] == pytest.approx(0.24 * 0.15 + 0.1)
    assert small.texts[0][0] == "+0.14"
    assert large.diverging
    assert large.largest <= 20.0


def test_dead_times_are_no_quantities() -> None:
    assert all("282" not in heat.x for heat in error_maps(map_record()["data"]))


def test_many_energising_times_share_columns_and_the_largest_error_is_shown() -> None:
    record = map_record()
    data = record["data"][0]
    row = data["rows"][5]
    data["rows"] = [
        row | {"rail_pressure": rail, "energising_time": 1e-6 * (300 + i), "best": row["measured"] * (1.0 + 0.001 * i)}
        for rail in (40e6, 160e6)
        for i in range(100)
    ]
    (heat,) = error_maps(record["data"])
    assert len(heat.x) <= 22
    assert heat.values[0][-1] == pytest.approx(9.9)
    assert "largest error" in heat.caption


def test_curves_and_single_pressures_have_none() -> None:
    assert error_maps(rate_record()["data"]) == []
    record = map_record()
    record["data"] = record["data"][1:]  # the one at 80 MPa
    assert error_maps(record["data"]) == []
