"""The fixed processor of studies with `same_bits`: its functions, and machines that cannot run its kernels."""

from __future__ import annotations

import math
import platform
from pathlib import Path

import llvmlite.binding as llvm
import numpy as np
import pytest
from typer.testing import CliRunner

import commonrail as cr
from commonrail import fixed_target
from commonrail.cli.app import app
from commonrail.compile_target import describe
from commonrail.engine import lanes, library
from tests.store.conftest import write_small

POINT = cr.OperatingPoint(160e6, 300e-6)


def test_sine_cosine_and_exponential_of_the_kernels() -> None:
    for x in np.linspace(0.0, math.pi, 1001):
        assert fixed_target.sine(float(x)) == pytest.approx(math.sin(x), abs=2.0 * np.spacing(1.0))
        assert fixed_target.cosine(float(x)) == pytest.approx(math.cos(x), abs=2.0 * np.spacing(1.0))
    for x in -np.linspace(0.0, 700.0, 7001):
        assert fixed_target.exponential(float(x)) == pytest.approx(math.exp(x), rel=8.0 * np.spacing(1.0))
    assert fixed_target.exponential(-1e6) == 0.0


@pytest.mark.parametrize("lacking", ["avx2", "fma"])
def test_a_processor_without_a_feature_is_told_so(monkeypatch: pytest.MonkeyPatch, lacking: str) -> None:
    has = dict(llvm.get_host_cpu_features()) | dict.fromkeys(
        ("avx2", "fma", "bmi", "bmi2", "lzcnt", "f16c", "movbe"), True
    )
    monkeypatch.setattr(platform, "machine", lambda: "x86_64")
    monkeypatch.setattr(llvm, "get_host_cpu_features", lambda: has)
    assert fixed_target.missing() is None
    monkeypatch.setattr(llvm, "get_host_cpu_features", lambda: has | {lacking: False})
    with pytest.raises(cr.ConfigurationError, match=f"this one lacks {lacking}; omit same_bits"):
        fixed_target.fixed_processor()


def test_a_study_ends_with_that_sentence_and_status_2(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    study = write_small(tmp_path / "small")
    study.write_text(study.read_text(encoding="utf-8").replace("seed = 1", "same_bits = true\nseed = 1", 1), "utf-8")
    monkeypatch.setattr(platform, "machine", lambda: "arm64")
    monkeypatch.setenv("COMMONRAIL_KERNELS", "off")
    library.objection.cache_clear()
    lanes.compiled.cache_clear()  # no kernel of another test
    try:
        ended = CliRunner().invoke(app, ["calibrate", str(study), "--out", str(tmp_path / "run")])
    finally:
        for cache in (describe, library.objection):
            cache.cache_clear()
    assert ended.exit_code == 2
    assert "this machine is of kind arm64; omit same_bits" in " ".join(ended.output.split())


@pytest.mark.parametrize("engine", ["cuda", "reference"])
def test_other_engines_do_not_promise_bits(monkeypatch: pytest.MonkeyPatch, engine: str, rigid: cr.Injector) -> None:
    monkeypatch.setattr("commonrail.engine.cuda.missing", lambda: None)
    with pytest.raises(cr.ConfigurationError, match=f'for the engine "lanes" alone, not for "{engine}"'):
        cr.simulate(rigid, POINT, engine, same_bits=True)


@pytest.mark.skipif(fixed_target.missing() is not None, reason="this processor lacks AVX2 or FMA, or is no x86-64")
def test_the_result_is_that_of_this_machine_to_rounding(rigid: cr.Injector) -> None:
    names, values = ["nozzle.discharge_maximum"], np.linspace(0.75, 0.9, 19)[:, None]
    one, two, own = (
        cr.simulate_batch(rigid, [POINT], names, values, threads=threads, same_bits=same)
        for threads, same in ((1, True), (2, True), (1, False))
    )
    assert one.injected_mass.tobytes() == two.injected_mass.tobytes()
    # two orders of rounding; the largest difference between one lane and eight was 4e-13
    np.testing.assert_allclose(one.injected_mass, own.injected_mass, rtol=1e-10)
