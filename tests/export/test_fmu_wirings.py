"""FMUs of other wirings than the drawn one against the lanes: traces of the coil, a rail, a rigid body."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from commonrail.choices import Body, Boundary, Drive
from commonrail.engine.operating_point import OperatingPoint, Trace
from commonrail.engine.simulate import simulate
from commonrail.export.fmu import write_fmu
from commonrail.export.objects import target_named
from commonrail.files.injector_file import load_injector
from tests.conftest import DRAWN
from tests.export.fmi2 import OK, Binary
from tests.export.test_library import ROUNDING, inputs_of

fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed: pip install 'commonrail[fmi]'")

pytestmark = pytest.mark.slow  # each wiring is compiled, some twelve seconds of processor time

CURRENT = Trace.of([0.0, 60e-6, 120e-6, 500e-6, 560e-6, 2e-3], [0.0, 20.0, 12.0, 12.0, 0.0, 0.0])
VOLTAGE = Trace.of([0.0, 1e-6, 80e-6, 90e-6, 500e-6, 510e-6, 2e-3], [0.0, 60.0, 60.0, 12.0, 12.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("changes", "trace"),
    [
        ({"drive": Drive.CURRENT}, CURRENT),
        ({"drive": Drive.VOLTAGE}, VOLTAGE),
        ({"body": Body.RIGID}, None),
        ({"boundary": Boundary.VOLUME}, None),
    ],
    ids=["current", "voltage", "rigid", "rail"],
)
def test_another_wiring_is_that_of_the_lanes(changes, trace, own, tmp_path):
    injector = load_injector(DRAWN)
    injector = replace(injector, variant=injector.variant._replace(**changes))
    path = tmp_path / "injector.fmu"
    write_fmu(injector, path, [target_named(own)])
    description = fmpy.read_model_description(str(path))
    references = {v.name: v.valueReference for v in description.modelVariables}
    (library,) = fmpy.extract(str(path)).glob("binaries/*/*")
    one = Binary(library, description.guid).instance()
    point = OperatingPoint(120e6, 500e-6, horizon=1.5e-3, drive=trace)
    names = ["boundary.rail_pressure", *(["energising[1].duration"] if trace is None else [])]
    assert one.set([references[name] for name in names], [120e6, 500e-6][: len(names)]) == OK
    assert one.begin() == OK
    for k, row in enumerate(inputs_of(injector, point)):
        if trace is not None:
            assert one.set([references["boundary.drive"]], row[3:4]) == OK  # its mean over the step
        assert one.step(1e-6 * k, 1e-6) == OK
    solution = simulate(injector, point)
    watched = ["injected", "needle_lift", "sac_pressure", "coil_current"]
    found = dict(zip(watched, one.get([references[name] for name in watched]), strict=True))
    one.free()
    assert solution.injected_mass > 1e-6
    assert found["injected"] == pytest.approx(solution.injected_mass, rel=ROUNDING)
    for name in watched[1:]:
        course = solution.channels[name]
        assert abs(found[name] - course[-1]) <= ROUNDING * np.max(np.abs(course)), name
