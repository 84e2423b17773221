"""The paper's problem: seven stiffnesses in order (Table 1, Eq. (14) to (16))."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from commonrail.calibration.parameter import Parameter, percent_bounds
from commonrail.calibration.space import Space
from tests.readers.conftest import injector_file, study_file, table_file  # noqa: F401

THEORETICAL = (1.22e8, 8.08e7, 8.21e7, 9.44e7, 9.43e7, 1.86e8, 5.82e7)
OPTIMAL = (3.03e8, 8.26e7, 8.35e7, 1.41e8, 1.05e8, 3.50e8, 6.44e7)
ORDERING = "k7 < k2 < k3 < k5 < k4 < k1 < k6"

SpaceFactory = Callable[..., Space]


@pytest.fixture(scope="session")
def paper_space() -> SpaceFactory:
    """Space of the paper with the same percentages for every stiffness, or a_max for k1 alone."""

    def build(percent: float = 100.0, k1_max: float | None = None, ordered: bool = True) -> Space:
        parameters = []
        for index, value in enumerate(THEORETICAL):
            a_max = k1_max if k1_max is not None and index == 0 else percent
            lower, upper = percent_bounds(value, percent, a_max)
            parameters.append(
                Parameter(f"k{index + 1}", value, lower, upper, "N/m", mark="F", source="Table 1, Eq. (8)")
            )
        return Space(parameters, [ORDERING] if ordered else [])

    return build


@pytest.fixture(scope="session")
def optimal() -> np.ndarray:
    """The paper's optimal stiffnesses, N/m."""
    return np.array(OPTIMAL)
