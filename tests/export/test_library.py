"""The exported library against the lanes, and what it promises of its memory."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.simulate import simulate
from commonrail.files.injector_file import load_injector
from tests.conftest import DRAWN
from tests.export.native import Native, Run

BOUNDARY = (160e6, 5e6, 0.5e6, 0.0)
# The compiler contracts products and sums in other places than in the lanes, and the valve's and the needle's
# contacts amplify that rounding: 1e-13 measured.
ROUNDING = 1e-11


@pytest.fixture(scope="module")
def injector():
    return load_injector(DRAWN)


def deviations(solution, courses):
    """Largest deviation of each channel, relative to its peak."""
    expected = {**solution.channels, "injected": solution.injected}
    return {
        name: float(np.max(np.abs(courses[name] - values)) / np.max(np.abs(values)))
        for name, values in expected.items()
    }


def test_an_injection_has_the_channels_of_the_lanes(native: Native, injector):
    point = OperatingPoint(160e6, 700e-6, horizon=2e-3)
    solution = simulate(injector, point)
    run = Run(native, BOUNDARY)
    assert run.plan((0.0, 700e-6)) == 0
    found = deviations(solution, run.courses(2000))
    assert len(found) == 12
    assert max(found.values()) < ROUNDING, found
    figures = run.figures()
    assert figures.opening == pytest.approx(solution.opening, rel=ROUNDING)
    assert figures.closing == pytest.approx(solution.closing, rel=ROUNDING)
    assert figures.returned == pytest.approx(solution.returned_mass, rel=ROUNDING)
