"""The virtual injector of the catalogue, wired in the ways that the tests of physics and engines need.

Each variant is one kernel, compiled at its first use and then kept on disk: take one of these.
"""

from __future__ import annotations

import gc
import signal
from collections.abc import Iterator
from dataclasses import replace

import pytest
from hypothesis import HealthCheck, settings

from commonrail.base.choices import Body, Boundary, Drive
from commonrail.physics.injector import Injector
from commonrail.physics.variants import Variant
from commonrail.readers.injector import load_injector
from tests.judging import FEW, judged_by
from tests.workers.forked import forked

# How long an example takes is the machine's business: no deadline, and nothing is called too slow.
settings.register_profile("commonrail", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("commonrail")

DRAWN = "virtual-lino-2016"

# Kernels share their laws: of each kind (double precision, single precision, the reference, another processor) the
# first in a process takes twice to three times the time of the others. The process that is given the first half of the
# tests begins with tests of all wirings in double precision, the other with the other kinds, by tests that need no
# kernel in double precision while those are compiled; then with those that compare the kinds. Whoever is done takes
# over from the end of a half.
DOUBLE = (
    "engine/test_closings.py::test_closings_are_those_of_the_lift",
    "verification/test_conservation.py",
    "engine/test_simulate.py",
    "verification/test_extended_laws.py::test_a_varying_law",
    "verification/test_direct_acting.py::test_what_the_rail",
    "verification/test_magnet.py",
)
OTHERS = (
    "engine/test_precision.py::test_mass_is_kept",
    "engine/test_reference_march.py",
    "plugins/stepper/test_stepper.py::test_stepping_gives",
    "plugins/paper/test_virtual_bench.py",
    "runs/test_same_bits.py",
    "engine/test_reference.py",
    *(f"engine/test_{name}.py" for name in ("precision", "streaming", "closings", "validity")),
    "equivalence/test_lanes_and_reference.py",
    "benchmarks/test_solvers.py",
    "benchmarks/test_throughput.py",
    "runs/test_precision.py",
    "plugins/verification/test_outside.py",
    "physics/test_feed_pipe.py",
    "plugins/paper/",
    "plugins/paper/test_reproduce.py",
)


# Whatever is imported and collected lives as long as the tests do: looking through it for garbage again and again takes
# a tenth of their processor time.
gc.disable()


def pytest_collection_finish() -> None:
    """Look for garbage from here on, among what tests make, and less often than by default."""
    gc.freeze()
    gc.set_threshold(50_000, 20, 100)
    gc.enable()


@pytest.hookimpl(trylast=True)  # when those that are left out are gone
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put tests of the same kind of kernel into the same process."""
    rest = list(items)

    def taken(names: tuple[str, ...]) -> list[pytest.Item]:
        found = []
        for name in names:
            of_name = [i for i in rest if i.nodeid.removeprefix("tests/").startswith(name)]
            found += of_name
            rest[:] = [i for i in rest if i not in set(of_name)]
        return found

    first, second = taken(DOUBLE), taken(OTHERS)
    half = max(0, len(items) // 2 - len(first))
    items[:] = [*first, *rest[:half], *second, *rest[half:]]


# A shell that starts a job in the background lets it ignore signals, which a run respects; the tests send some.
for _number, _handler in ((signal.SIGINT, signal.default_int_handler), (signal.SIGTERM, signal.SIG_DFL)):
    if signal.getsignal(_number) is signal.SIG_IGN:
        signal.signal(_number, _handler)
if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


def wired(variant: Variant) -> Injector:
    """The virtual injector in another wiring."""
    return replace(load_injector(DRAWN), variant=variant)


@pytest.fixture(scope="session", autouse=True)
def still_reports() -> Iterator[None]:
    """Reports have still charts: one that simulates is compiled for each wiring. Tests of the page have it again."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("commonrail.report.page._live", lambda record, folder: "")
        yield


@pytest.fixture(scope="session", autouse=True)
def short_judgements() -> Iterator[None]:
    """Fits are judged from few draws. Tests of what judges them have as many as the user."""
    with judged_by(FEW):
        yield


@pytest.fixture(scope="module")
def forked_workers() -> Iterator[None]:
    """Workers that the tests of a module start are forked."""
    with forked():
        yield


@pytest.fixture(scope="session")
def pwm() -> Injector:
    """As in the catalogue: flexible body, ideal rail, PWM."""
    return wired(Variant(drive=Drive.PWM))


@pytest.fixture(scope="session")
def regulated() -> Injector:
    """Its smooth twin: the current follows its plan exactly."""
    return wired(Variant())


@pytest.fixture(scope="session")
def rigid() -> Injector:
    """Plunger and needle as one mass, PWM."""
    return wired(Variant(Body.RIGID, drive=Drive.PWM))


@pytest.fixture(scope="session")
def volume() -> Injector:
    """Fed from a rail volume behind a throttle."""
    return wired(Variant(boundary=Boundary.VOLUME))


@pytest.fixture(scope="session")
def rigid_volume() -> Injector:
    """Plunger and needle as one mass, fed from a rail volume."""
    return wired(Variant(Body.RIGID, Boundary.VOLUME))


@pytest.fixture(scope="session")
def by_voltage() -> Injector:
    """Driven by a measured voltage."""
    return wired(Variant(drive=Drive.VOLTAGE))


@pytest.fixture(scope="session")
def by_current() -> Injector:
    """Driven by a measured current."""
    return wired(Variant(drive=Drive.CURRENT))
