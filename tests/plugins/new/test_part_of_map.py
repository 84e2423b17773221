"""Points of a large map at which parameters are screened."""

from __future__ import annotations

from pathlib import Path

from commonrail.plugins.new.study import _part_of_map
from commonrail.readers.tables import read_found_map


def test_a_map_of_many_points_is_screened_on_a_part(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    rows = [f"{p},{t},{p * t * 1e-4}" for p in range(200, 1500, 100) for t in range(200, 1500, 100)]
    path.write_text("\n".join(["p [bar],ET [us],q [mm3]", *rows]), encoding="utf-8")
    chosen = _part_of_map(read_found_map(path), 60)
    assert 1 < len(chosen["rail_pressure"]) * len(chosen["energising_time"]) <= 60
    assert _part_of_map(read_found_map(path), 200) == {}
