"""Study of a quantity map, for tests: its file is ``map.csv`` beside the study."""

from __future__ import annotations

_DATA = """
format = "commonrail-study/1"
title = "map"
injector = "cri2-16"

[[data]]
kind = "quantities"
name = "map"
role = "{role}"
file = "map.csv"
cylinder_pressure = "0.5 MPa"
return_pressure = "0.1 MPa"
{keys}
"""

# One parameter that every quantity depends on, and the shortest search.
A_HOLE = """
[[parameter]]
name = "control_chamber.a_hole_diameter"
lower = "190 um"
upper = "240 um"

[optimiser]
generations = 2
members = 6
"""


def map_study(keys: str = "", role: str = "fit", more: str = A_HOLE) -> str:
    """Text of a study with keys of its map, and what stands after the data."""
    return _DATA.format(role=role, keys=keys) + more
