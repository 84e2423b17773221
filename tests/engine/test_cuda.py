"""The CUDA engine: the lanes' figures under the simulator, machine code without a GPU, what it says if it cannot."""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from commonrail.base.choices import Precision
from commonrail.base.errors import ConfigurationError
from commonrail.engine import cuda
from commonrail.engine.lanes import Misfit
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.simulate import simulate, simulate_batch
from commonrail.engine.solution import Batch
from commonrail.engine.status import Status
from commonrail.physics.injector import Injector
from commonrail.physics.variants import Variant

ROOT = Path(__file__).resolve().parents[2]
NAMES = ("plunger_needle.k1", "feed_pipe.length", "nozzle.hole_diameter", "fuel.temperature")
# in the second nothing moves: it has closed for good before its end
POINTS = [OperatingPoint(160e6, 200e-6, horizon=450e-6), OperatingPoint(80e6, 20e-6, horizon=300e-6)]
FIGURES = ("injected_mass", "returned_mass", "opening", "closing", "greatest_lift", "absolute_error", "squared_error")


def candidates(injector: Injector) -> np.ndarray:
    own = np.array([injector.values[name] for name in NAMES])
    return own * np.array([[1.0, 1.0, 1.0, 1.0], [0.9, 1.3, 1.05, 0.9], [1.1, 0.7, 0.95, 1.1]])


def misfit() -> Misfit:
    """Bounds on and between steps, two in one step, and fewer of them at the second point."""
    bounds = np.stack([np.linspace(0.0, 449.5, 60), np.linspace(0.0, 59.0, 60)])
    bounds[:, 5] = bounds[:, 4] + 0.25
    target = np.random.default_rng(3).uniform(0.0, 4e-5, bounds.shape)
    weight, density = np.linspace(0.5, 2.0, 120).reshape(2, 60), np.array([[np.nan, 800.0]])
    return Misfit(np.array([60, 40]), bounds, target, weight, density)


def first(both: Misfit) -> Misfit:
    """The misfit of the first point alone."""
    return Misfit(*(column[:1] for column in both))


# The simulator needs neither a GPU nor numba-cuda; Numba reads the variable when it is imported: a process of its own.
CODE = """
import sys
import numpy as np
from dataclasses import replace
from commonrail.engine import cuda
from commonrail.engine.simulate import simulate, simulate_batch
from commonrail.readers.injector import (
    load_injector,
)
from tests.engine import test_cuda as here
chopped = load_injector("virtual-lino-2016")
injector = replace(chopped, variant=here.Variant())
values = here.candidates(injector)
def batch(points, chosen, injector=injector, **how):
    return here.table(simulate_batch(injector, points, here.NAMES, chosen, engine="cuda", **how))
kept = {"whole": batch(here.POINTS, values, misfit=here.misfit()), "until_closed": batch(here.POINTS, values)}
kept["single"] = batch(here.POINTS[:1], values, chopped, misfit=here.first(here.misfit()), precision="f32")
kept["rate"] = simulate(injector, here.POINTS[0], engine="cuda").mass_rate
many = values[0] * np.linspace(0.9, 1.1, 69)[:, None]
short = [here.OperatingPoint(80e6, 20e-6, horizon=30e-6)]
kept["together"] = batch(short, many)
cuda._at_a_time = lambda *_: cuda.GROUP
kept["parts"] = batch(short, many[::-1])[:, ::-1]
np.savez(sys.argv[1], **kept)
"""


def table(batch: Batch) -> np.ndarray:
    """(figures and status, candidates, points)"""
    return np.array([getattr(batch, name) for name in FIGURES] + [batch.status])


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> dict[str, np.ndarray]:
    """Result of the kernel run by Python, thread by thread."""
    path = tmp_path_factory.mktemp("cuda") / "figures.npz"
    environment = os.environ | {"NUMBA_ENABLE_CUDASIM": "1"}
    environment["PYTHONPATH"] = os.pathsep.join([str(ROOT), *sys.path])
    subprocess.run([sys.executable, "-c", CODE, str(path)], check=True, env=environment, cwd=ROOT)
    with np.load(path) as kept:
        return dict(kept)


# Rounding alone differs: the lanes contract and reorder sums, Python does not. 5e-14 was seen.
ROUNDING = 1e-11


@pytest.mark.process
def test_rates_are_those_of_the_lanes(simulated: dict[str, np.ndarray], regulated: Injector) -> None:
    own = simulate(regulated, POINTS[0]).mass_rate
    assert own.max() > 0.01  # [kg/s]: it injects
    assert np.abs(simulated["rate"] - own).sum() / own.sum() < ROUNDING


@pytest.mark.process
@pytest.mark.parametrize(("kind", "compared"), [("whole", misfit()), ("until_closed", None)])
def test_figures_are_those_of_the_lanes(
    simulated: dict[str, np.ndarray], regulated: Injector, kind: str, compared: Misfit | None
) -> None:
    own = table(simulate_batch(regulated, POINTS, NAMES, candidates(regulated), misfit=compared))
    assert np.isfinite(own[[0, 2], :, 0]).all()  # masses and openings
    assert len(np.unique(own[0, :, 0])) == 3
    assert (own[-1, :, 1] == Status.OK).all()  # closed
    np.testing.assert_allclose(simulated[kind], own, rtol=ROUNDING, atol=1e-18)


@pytest.mark.process
def test_single_precision_comes_near(simulated: dict[str, np.ndarray], pwm: Injector) -> None:
    values = candidates(pwm)
    own = table(simulate_batch(pwm, POINTS[:1], NAMES, values, misfit=first(misfit()), precision="f32"))
    # both round in 24 bits, not in the same places; 2e-5 was seen
    np.testing.assert_allclose(simulated["single"], own, rtol=2e-4)


@pytest.mark.process
def test_parts_do_not_change_a_bit(simulated: dict[str, np.ndarray]) -> None:
    assert len(np.unique(simulated["parts"][1])) == 69  # a whole launch of 64 threads and a smaller one
    np.testing.assert_array_equal(simulated["parts"], simulated["together"])


def test_samples_are_due_when_the_lanes_take_them() -> None:
    bounds = np.array([[0.0, 0.5, 1.0, 1.25, 1.75, 4.0, 9.5]])
    found = Misfit(np.array([7]), bounds, 2.0 * bounds, 3.0 * bounds, np.ones((1, 1))).samples(0.5, np.array([10]))
    taken, bound = [], 0
    for k in range(10):
        while bound < 7 and bounds[0, bound] <= k + 1.0:
            taken.append((k, bounds[0, bound] - k))
            bound += 1
    assert [(k, part) for k, part in zip(found.due[0], found.samples[0, :, 0], strict=True)] == taken
    np.testing.assert_array_equal(found.samples[0, :, 1], [1.0, 0.25, 0.25, 0.125, 0.25, 1.125, 2.75])
    np.testing.assert_array_equal(found.samples[0, :, 2:], np.stack([2.0 * bounds[0], 3.0 * bounds[0]], axis=1))


def test_a_bound_behind_the_last_step_by_rounding_is_due_at_its_end() -> None:
    bounds = np.array([[0.0, 2.0, np.nextafter(4.0, 5.0)]])
    found = Misfit(np.array([3]), bounds, bounds, bounds, np.ones((1, 1))).samples(0.5, np.array([4]))
    assert found.due.tolist() == [[0, 1, 3]]
    assert found.samples[0, :, 0].tolist() == [0.0, 1.0, 1.0]


@pytest.mark.parametrize(("count", "free", "threads"), [(1, 1e9, 64), (65, 1e9, 128), (10**6, 2e6, 960), (5, 10, 64)])
def test_a_launch_is_of_whole_groups_that_memory_holds(count: int, free: float, threads: int) -> None:
    device = SimpleNamespace(current_context=lambda: SimpleNamespace(get_memory_info=lambda: (free, 1e10)))
    assert cuda._at_a_time(device, count, 1000) == threads  # of 1000 bytes each, in half of what is free


def test_cuda_is_not_imported_before_it_is_asked_for() -> None:
    code = "import sys, commonrail.engine.simulate, commonrail.engine.cuda; assert 'numba.cuda' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True, env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)})


def test_what_is_missing_is_said(regulated: Injector, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cuda.importlib.util, "find_spec", lambda name: None)
    for call in (
        lambda: simulate(regulated, POINTS[0], engine="cuda"),
        lambda: simulate_batch(regulated, POINTS, engine="cuda"),
    ):
        with pytest.raises(ConfigurationError, match=r"numba-cuda; .*'commonrail\[cuda\]'"):
            call()


def test_a_missing_library_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cuda.importlib.util, "find_spec", lambda name: name)
    monkeypatch.setattr(cuda, "_missing_library", lambda: "nvvm")
    assert "library nvvm" in str(cuda.missing())


def test_a_missing_device_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    from numba import cuda as numba_cuda

    monkeypatch.setattr(cuda.importlib.util, "find_spec", lambda name: name)
    monkeypatch.setattr(cuda, "_missing_library", lambda: None)
    monkeypatch.setattr(numba_cuda, "is_available", lambda: False)
    assert "NVIDIA GPU" in str(cuda.missing())
    monkeypatch.setattr(numba_cuda, "is_available", lambda: True)
    assert cuda.missing() is None


def test_a_device_that_fails_is_said(regulated: Injector, monkeypatch: pytest.MonkeyPatch) -> None:
    from numba.cuda.cudadrv.driver import CudaAPIError

    def fail(*arguments: Any) -> None:
        raise CudaAPIError(2, "out of memory")

    monkeypatch.setattr(cuda, "missing", lambda: None)
    monkeypatch.setattr(cuda, "_launch", fail)
    with pytest.raises(ConfigurationError, match=r'GPU .*memory.*"lanes"'):
        simulate_batch(regulated, POINTS, engine="cuda")


@pytest.mark.parametrize(
    ("engine", "sentence"), [("reference", "one injection"), ("gpu", '"lanes", "cuda" or "reference"')]
)
def test_other_engines_are_refused(regulated: Injector, engine: str, sentence: str) -> None:
    with pytest.raises(ConfigurationError, match=sentence):
        simulate_batch(regulated, POINTS, engine=engine)


def no_compiler() -> str | None:
    """Reason why the kernel cannot be compiled to PTX here; that needs no GPU."""
    if importlib.util.find_spec("numba_cuda") is None:
        return "numba-cuda is not installed: no PTX"
    library = cuda._missing_library()
    return None if library is None else f"NVIDIA's library {library} was not found: no PTX"


compiler = pytest.mark.skipif(no_compiler() is not None, reason=str(no_compiler()))


@pytest.fixture(scope="module")
def instructions() -> dict[Precision, list[str]]:
    """Instructions of the loop over the steps, for compute capability 9.0."""
    from numba import cuda as numba_cuda
    from numba.cuda import dispatcher

    from commonrail.engine import cuda_kernel

    cuda_kernel.open_device()
    texts = {}
    with pytest.MonkeyPatch.context() as patch:
        # the inlined laws are compiled for "the current device"
        patch.setattr(dispatcher, "get_current_device", lambda: SimpleNamespace(compute_capability=(9, 0)))
        for precision in Precision:
            march = cuda_kernel.make_march(Variant(), precision, False)
            types = cuda_kernel.signature(precision)
            texts[precision], _ = numba_cuda.compile(march, types, cc=(9, 0), device=False, output="ptx", abi="numba")
    for precision, text in texts.items():
        print(precision.value, Counter(map(kind, step_loop(text))).most_common())
    return {precision: step_loop(text) for precision, text in texts.items()}


def kind(instruction: str) -> str:
    """Its name without the registers, such as fma.rn.f64."""
    return re.sub(r"^@\S+ ", "", instruction).split()[0].rstrip(";")


def step_loop(ptx: str) -> list[str]:
    """Instructions of the greatest loop of the kernel: the largest set of blocks that reach one another."""
    body = ptx[ptx.index(".entry") :].split("\n}\n")[0]
    blocks = [part.splitlines() for part in re.split(r"\n(?=\$L__BB)", body)]
    place = {lines[0].split(":")[0]: i for i, lines in enumerate(blocks)}
    edges = []
    for i, lines in enumerate(blocks):
        targets = re.findall(r"bra(?:\.uni)?\s+(\$L__BB\w+)", "\n".join(lines))
        edges += [(i, place[target]) for target in targets]
        if not re.search(r"^\s*(bra\.uni|ret)", lines[-1]) and i + 1 < len(blocks):
            edges.append((i, i + 1))
    ends = np.array(edges).T
    shape = (len(blocks), len(blocks))
    _, loops = connected_components(coo_array((np.ones(len(edges)), ends), shape), connection="strong")
    code = [[line.strip() for line in lines if re.match(r"\s+(@\S+ )?[a-z]", line)] for lines in blocks]
    sizes = np.bincount(loops, [len(lines) for lines in code])
    return [line for lines, loop in zip(code, loops, strict=True) if loop == sizes.argmax() for line in lines]


@compiler
def test_single_precision_touches_no_double_in_a_step(instructions: dict[Precision, list[str]]) -> None:
    loop = instructions[Precision.F32]
    assert any(kind(line).startswith("fma.rn.f32") for line in loop)
    assert [line for line in loop if ".f64" in line] == []
    assert any(".f64" in line for line in instructions[Precision.F64])  # the search would see them


def no_device() -> str | None:
    """Reason why nothing can run on a GPU here."""
    return cuda.missing()


@pytest.mark.gpu
@pytest.mark.skipif(no_device() is not None, reason=str(no_device()))
@pytest.mark.parametrize(("precision", "tolerance"), [("f64", 1e-6), ("f32", 2e-3)])
def test_a_gpu_gives_the_lanes_figures(regulated: Injector, precision: str, tolerance: float) -> None:
    values = np.tile(candidates(regulated), (100, 1))
    own, found = (
        table(simulate_batch(regulated, POINTS, NAMES, values, misfit=misfit(), precision=precision, engine=engine))
        for engine in ("lanes", "cuda")
    )
    np.testing.assert_allclose(found, own, rtol=tolerance, atol=1e-12)


@pytest.mark.gpu
@pytest.mark.skipif(no_device() is not None, reason=str(no_device()))
def test_a_gpu_gives_the_lanes_rate(regulated: Injector) -> None:
    own, found = (simulate(regulated, POINTS[0], engine=engine).mass_rate for engine in ("lanes", "cuda"))
    assert np.abs(found - own).sum() / own.sum() < 1e-6
