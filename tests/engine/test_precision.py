"""Single precision: as the double one but for rounding, and without a trace on the thread that it ran on."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numba
import numpy as np
import pytest

from commonrail.base.choices import Precision
from commonrail.base.errors import ConfigurationError
from commonrail.compiler import child
from commonrail.compiler import laws as jit
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.simulate import simulate, simulate_batch
from commonrail.engine.status import Status
from commonrail.physics import law as laws
from commonrail.physics.injector import Injector
from commonrail.plugins.verification.run import difference
from tests.compiler import doubled
from tests.engine.test_batch import POINTS, K, failing, same_bits, stiffnesses

compiled = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="the JIT is switched off: all numbers are double")


def in_f32(injector: Injector, values: np.ndarray, threads: int = 1) -> Any:
    return simulate_batch(injector, POINTS, K, values, threads=threads, precision="f32")


@compiled
# Both of each: body, rail and drive.
@pytest.mark.parametrize("wiring", ["pwm", pytest.param("rigid_volume", marks=pytest.mark.slow)])
@pytest.mark.parametrize("pressure", [40e6, 160e6])
def test_single_and_double_agree(request: pytest.FixtureRequest, wiring: str, pressure: float) -> None:
    injector, point = request.getfixturevalue(wiring), OperatingPoint(pressure, 700e-6)
    double, single = (simulate(injector, point, sample_interval=3e-6, precision=p) for p in Precision)
    found = difference(single, double)
    assert found.rate > 0.0  # they are two computations
    # Seen at 40 to 180 MPa, five pressures each: rate 0.0007 to 0.0056 %, volume 0.0053 %, opening 0.021 us, closing
    # 0.011 us. The step's own error is 0.03 % and more: rounding must stay well below it.
    assert found.rate < 0.015
    assert abs(found.volume) < 0.015
    assert abs(found.opening) < 0.1
    assert abs(found.closing) < 0.1


@compiled
@pytest.mark.parametrize("drive", ["pwm", "regulated"])
def test_mass_is_kept_to_the_rounding_of_its_sum(request: pytest.FixtureRequest, drive: str) -> None:
    solution = simulate(request.getfixturevalue(drive), OperatingPoint(160e6, 700e-6), precision="f32")
    # seen: 2e-5 at most, sums of some 2000 steps of 6e-8 each; f64 keeps it to 1e-13
    assert 1e-10 < abs(solution.balance) < 1e-4


@compiled
def test_threads_do_not_change_a_bit(pwm: Injector) -> None:
    values = stiffnesses(pwm, 37)  # three blocks of 16, the last not full
    one = in_f32(pwm, values)
    for threads in (2, 5):
        same_bits(one, in_f32(pwm, values, threads), slice(None), slice(None))


@compiled
def test_a_candidate_does_not_see_its_neighbours(pwm: Injector) -> None:
    values = stiffnesses(pwm, 37)
    whole = in_f32(pwm, values)
    for i in (0, 7, 16, 36):
        same_bits(whole, in_f32(pwm, values[i : i + 1]), slice(i, i + 1), slice(0, 1))
    same_bits(whole, in_f32(pwm, values[::-1]), slice(None), slice(None, None, -1))
    spoilt = in_f32(pwm, failing(pwm, values))
    same_bits(whole, spoilt, slice(6, None), slice(6, None))


@compiled
def test_what_fails_fails_for_the_same_reason(pwm: Injector) -> None:
    values = failing(pwm, stiffnesses(pwm, 16))
    single, double = in_f32(pwm, values), simulate_batch(pwm, POINTS, K, values)
    both = single.failed & double.failed
    assert both[1:6].all()
    assert not single.failed[6:].any()
    assert np.array_equal(single.status[both], double.status[both])
    assert np.isnan(single.injected_mass[both]).all()


@compiled
def test_a_needle_that_does_not_close_is_told(pwm: Injector) -> None:
    name = ("plunger_needle.plunger_diameter",)
    batch = simulate_batch(pwm, POINTS, name, np.array([[2.0e-3], [4.3e-3]]), precision="f32")
    assert batch.status.tolist() == [[Status.NOT_CLOSED_AT_START] * 2, [Status.OK] * 2]


def test_an_unknown_precision_is_refused(pwm: Injector) -> None:
    with pytest.raises(ConfigurationError, match=r'"f64".*"f32".*"f16"'):
        simulate_batch(pwm, POINTS, precision="f16")
    with pytest.raises(ConfigurationError, match="f64 alone"):
        simulate(pwm, POINTS[0], "reference", precision="f32")


@numba.njit
def product(a: float, b: float) -> float:
    return a * b


def makes_tiny_numbers() -> bool:
    """Return whether this thread's processor still computes with numbers below 2.2e-308."""
    return 0.0 < product(1e-300, 1e-10) < 1e-309


@compiled
@pytest.mark.parametrize("precision", list(Precision))
def test_a_run_leaves_the_thread_as_it_was(pwm: Injector, precision: Precision) -> None:
    assert makes_tiny_numbers()
    simulate_batch(pwm, POINTS, K, stiffnesses(pwm, 3), threads=1, precision=precision)
    assert makes_tiny_numbers()


@compiled
def test_the_flush_of_tiny_numbers_can_be_seen_and_undone() -> None:
    """Else the test above could not fail."""

    @numba.njit
    def flushed(a: float, b: float) -> tuple[float, int, int]:
        mode = jit.exchange_rounding(laws.FLUSH_TINY, laws.KEEP_ALL)
        c = product(a, b)
        return c, mode, jit.exchange_rounding(mode, laws.KEEP_NONE)

    c, before, inside = flushed(1e-300, 1e-10)
    if inside == 0:
        pytest.skip("this processor has no such register")
    assert c == 0.0
    assert inside == before | 0x8040
    assert makes_tiny_numbers()


class Pair(NamedTuple):
    """A tuple with names, as constants of laws are."""

    first: float
    second: int


RATIO, TABLE = 0.1, (0.1, (2.5, 3), "x")
MIXED = Pair(0.1, 3)


def law(x: Any) -> Any:
    return (RATIO, TABLE, MIXED, (0.2, 7), 5, 1.5 * x, math.pi)


def kinds(value: Any) -> Iterator[type]:
    for item in value:
        yield from kinds(item) if isinstance(item, tuple) else [type(item)]


def test_a_twin_has_single_constants_and_leaves_the_rest() -> None:
    twin = laws.in_single(law)
    ratio, table, mixed, literal, five, *_ = twin(np.float32(2.0))
    assert type(ratio) is np.float32
    assert list(kinds(table)) == [np.float32, np.float32, int, str]
    assert type(mixed) is Pair
    assert list(kinds([mixed])) == [np.float32, int]
    assert list(kinds([literal])) == [np.float32, int]
    assert type(five) is int
    assert type(twin(np.float32(2.0))[5]) is np.float32
    assert type(law(2.0)[0]) is float  # the law itself is as it was
    assert laws.in_single(law) is twin


def make_law(factor: float, counts: tuple[int, int]) -> Callable[[Any], Any]:
    def scaled(x: Any) -> Any:
        return factor * x + counts[1]

    return scaled


def test_a_twin_has_its_closure_in_single() -> None:
    twin = laws.in_single(make_law(0.1, (1, 2)))
    counts, factor = (cell.cell_contents for cell in twin.__closure__ or ())
    assert type(factor) is np.float32
    assert list(kinds([counts])) == [int, int]
    assert twin(2.0) == 2.0 * float(np.float32(0.1)) + 2


def test_a_law_is_compiled_with_constants_of_the_precision_of_its_arguments() -> None:
    """Constants in double would draw everything that they touch along; so would that of a module."""
    (text,) = child.texts(doubled.source("single", "f32")).values()
    assert "fmul" in text
    assert not re.search(r"\bdouble\b", text)
