"""One lane or eight: the same source compiled scalar and as vectors agrees to rounding."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

# Another width is another kernel: a process of its own, with a cache of its own.
CODE = """
import sys
import numpy as np
import commonrail as cr
from commonrail.base.choices import Precision
from commonrail.engine.job import VECTORS
VECTORS[Precision.F64] = VECTORS[Precision.F64]._replace(lanes=int(sys.argv[1]))
from commonrail.calibration.objective import Objective
study = cr.load_study(sys.argv[2])
data = [one.changed(role=cr.data.Role.FIT) for one in study.data]
objective = Objective(study.injector, study.space.names, data, study.time_step, 1)
own = np.array([study.injector.values[name] for name in objective.names])
factors = np.random.default_rng(1).uniform(0.5, 2.0, (64, len(own)))
np.save(sys.argv[3], objective.misfits(own * factors))
"""
CASE = Path(__file__).resolve().parents[2] / "cases" / "paper" / "study.toml"


@pytest.mark.slow
def test_scalar_and_vector_code_agree_to_rounding(tmp_path: Path) -> None:
    found = []
    for width in (1, 8):
        path = tmp_path / f"{width}.npy"
        environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path / str(width)), "COMMONRAIL_KERNELS": "off"}
        subprocess.run([sys.executable, "-c", CODE, str(width), str(CASE), str(path)], check=True, env=environment)
        found.append(np.load(path))
    assert np.isfinite(found[0]).all()
    # 3.7e-13 was seen; both are sums of some 1e5 products, fused or not, each rounded at 1e-16
    np.testing.assert_allclose(found[0], found[1], rtol=1e-11)
