"""Kernels of `same_bits`: their functions, their bits, and machines that they are not promised for."""

from __future__ import annotations

import os
import platform
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import commonrail as cr
from commonrail.base.choices import Precision
from commonrail.compiler import child, target
from commonrail.compiler.target import describe
from commonrail.engine import lanes, machine_code
from commonrail.engine.job import VECTORS
from commonrail.physics.variants import Variant
from tests.cli.conftest import run_command
from tests.runs.conftest import write_small

ROOT = Path(__file__).resolve().parents[2]
POINT = cr.OperatingPoint(160e6, 300e-6)


@pytest.mark.slow
def test_no_leave_to_fuse_or_reorder_is_in_an_exact_text() -> None:
    flags = re.compile(r" (?:nsz|arcp|contract|reassoc|fast|nnan|ninf|afn) ")
    vector = VECTORS[Precision.F64]
    for exact in (False, True):
        (text,) = child.texts(machine_code.source_of(Variant("rigid"), vector, exact)).values()
        assert (len(flags.findall(text)) > 1000) is not exact
        assert bool(flags.search(text)) is not exact


def test_a_machine_of_another_kind_is_told_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(platform, "machine", lambda: "x86_64")
    assert target.exact_processor().exact
    monkeypatch.setattr(platform, "machine", lambda: "arm64")
    with pytest.raises(cr.errors.ConfigurationError, match=r"arm64.*same_bits"):
        target.exact_processor()


def test_a_study_ends_with_that_sentence_and_status_2(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    study = write_small(tmp_path / "small")
    study.write_text(study.read_text(encoding="utf-8").replace("seed = 1", "same_bits = true\nseed = 1", 1), "utf-8")
    monkeypatch.setattr(platform, "machine", lambda: "arm64")
    monkeypatch.setenv("COMMONRAIL_KERNELS", "off")
    machine_code.objection.cache_clear()
    lanes.load_loop.cache_clear()  # no kernel of another test
    try:
        ended = run_command("calibrate", study, "--out", tmp_path / "run")
    finally:
        for cache in (describe, machine_code.objection):
            cache.cache_clear()
    assert ended.status == 2
    assert re.search(r"arm64.*same_bits", ended.sentence)


@pytest.mark.parametrize("engine", ["cuda", "reference"])
def test_other_engines_do_not_promise_bits(monkeypatch: pytest.MonkeyPatch, engine: str, rigid: cr.Injector) -> None:
    monkeypatch.setattr("commonrail.engine.cuda.missing", lambda: None)
    with pytest.raises(cr.errors.ConfigurationError, match=f'"lanes".*"{engine}".*same_bits'):
        cr.simulate(rigid, POINT, engine, same_bits=True)


@pytest.mark.skipif(not target.is_x86(), reason="this machine is no x86-64")
def test_the_result_is_that_of_this_machine_to_rounding(rigid: cr.Injector) -> None:
    names, values = ["nozzle.discharge_maximum"], np.linspace(0.75, 0.9, 19)[:, None]
    one, two, own = (
        cr.simulate_batch(rigid, [POINT], names, values, threads=threads, same_bits=same)
        for threads, same in ((1, True), (2, True), (1, False))
    )
    assert one.injected_mass.tobytes() == two.injected_mass.tobytes()
    # two orders of rounding; the largest difference between one lane and eight was 4e-13
    np.testing.assert_allclose(one.injected_mass, own.injected_mass, rtol=1e-10)


CODE = """
import sys
import numpy as np
import commonrail as cr
from tests.compiler.test_exact import FACTORS, POINT, POINTS
injector = cr.load_injector(sys.argv[1])
values = np.array([injector.values[name] for name in FACTORS]) * np.linspace(0.95, 1.05, 19)[:, None]
batch = cr.simulate_batch(injector, POINTS, FACTORS, values, precision=sys.argv[2], same_bits=True)
one = cr.simulate(injector, POINT, precision=sys.argv[2], same_bits=True)
arrays = (batch.injected_mass, batch.returned_mass, batch.opening, batch.closing, batch.greatest_lift, one.injected)
sys.stdout.buffer.write(b"".join(np.ascontiguousarray(array).tobytes() for array in (*arrays, *one.channels.values())))
"""
FACTORS = ("nozzle.discharge_maximum", "valve.spring_preload")
POINTS = [cr.OperatingPoint(pressure, duration) for pressure in (40e6, 160e6) for duration in (250e-6, 700e-6)]
LEVELS = {
    "v2": {"NUMBA_CPU_NAME": "x86-64-v2", "NUMBA_CPU_FEATURES": ""},
    "v3": {"COMMONRAIL_KERNELS": "v3"},
    "own": {},
    "haswell": {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": "+avx2,+fma"},
}


@pytest.mark.slow
@pytest.mark.skipif(not target.is_x86(), reason="this machine is no x86-64")
@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_code_for_other_processors_gives_the_same_bits(precision: str) -> None:
    """Registers of 128, 256 and 512 bits, with and without fused operations, of the same source."""
    found = {}
    for level, variables in LEVELS.items():
        environment = os.environ | {"COMMONRAIL_KERNELS": "off", "PYTHONPATH": os.pathsep.join(sys.path)} | variables
        command = [sys.executable, "-c", CODE, "virtual-lino-2016", precision]
        found[level] = subprocess.run(command, env=environment, cwd=ROOT, capture_output=True, check=True).stdout
    assert len(found["own"]) > 8 * 10_000
    assert all(one == found["own"] for one in found.values()), [len(one) for one in found.values()]
