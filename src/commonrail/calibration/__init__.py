"""Calibration: the parameters to be found, the constraints between them, and the optimisers."""

from __future__ import annotations

from commonrail.calibration.constraint_text import parse_constraints
from commonrail.calibration.constraints import LinearConstraints
from commonrail.calibration.parameter import Parameter, percent_bounds
from commonrail.calibration.sampling import sample_feasible, sample_uniform
from commonrail.calibration.space import Space

__all__ = [
    "LinearConstraints",
    "Parameter",
    "Space",
    "parse_constraints",
    "percent_bounds",
    "sample_feasible",
    "sample_uniform",
]
