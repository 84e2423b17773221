"""Our own exported FMUs as foreign models: the truth is that of the fast engine."""

from __future__ import annotations

import numpy as np
import pytest

import commonrail as cr
from commonrail.plugins.export.fmu import write_fmu
from commonrail.plugins.export.object_files import find_target
from commonrail.plugins.multistart import MultiStartSettings
from tests.conftest import DRAWN
from tests.exporting import usable_platform

pytestmark = [pytest.mark.process, pytest.mark.slow]

PRELOAD, TRUTH = "valve.spring_preload", 1.06  # of the drawn value; half a minute of processor time
POINTS = [(160e6, 500e-6), (160e6, 700e-6), (100e6, 700e-6)]
STOP = 3e-3


@pytest.mark.parametrize("version", [2, 3])
def test_a_parameter_of_an_exported_injector_is_found_again(version, tmp_path):
    injector = cr.load_injector(DRAWN)
    path = tmp_path / "injector.fmu"
    write_fmu(injector, path, [find_target(usable_platform())], version)
    drawn = injector.values[PRELOAD]
    points = [cr.OperatingPoint(rail, time, horizon=STOP) for rail, time in POINTS]
    truth = injector.with_values({PRELOAD: TRUTH * drawn})
    measured = cr.simulate_batch(truth, points, time_step=1e-6).injected_mass[0]
    rows = [{"boundary.rail_pressure": rail, "energising[1].duration": time} for rail, time in POINTS]
    data = cr.fmu.fmu_rows("quantities", rows, {"injected": measured}, STOP, tolerance=1e-8, synthetic="simulated")
    method = cr.fit.Method(MultiStartSettings(members=6, starts=2))
    study = cr.fmu.fmu_study(path, data, free={PRELOAD: (0.8 * drawn, 1.2 * drawn)}, step=1e-4, method=method)
    fit = cr.fmu.calibrate_fmu(study, processes=1)
    # FMU and engine differ by rounding alone; the descent ends where a step gains nothing any more
    assert fit.best[PRELOAD] == pytest.approx(TRUTH * drawn, rel=1e-4)
    assert fit.simulated["best"]["quantities"] == pytest.approx(np.array(measured), rel=1e-4)
    assert not fit.failures
