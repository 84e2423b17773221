"""Blocks of injectors, in vector registers and one after another, against the same injectors alone."""

from __future__ import annotations

import ctypes
import math

import numpy as np
import pytest

from commonrail.engine.status import Status
from tests.plugins.export.native import BlockRun, Native, Run

# Operating points and trains of eight injectors that differ in all of them; each train switches between steps too.
BOUNDARIES = [(60e6 + 15e6 * i, 3e6 + 0.5e6 * i, 0.4e6 + 0.02e6 * i, 0.0) for i in range(8)]
TRAINS = [((20e-6 * i, 300e-6 + 40e-6 * i), (1100.25e-6 + 10e-6 * i, 200.3e-6)) for i in range(8)]
STEPS = 1900
WIDTHS = (1, 4, 8)  # one after another, AVX2, AVX-512


def values_of(native: Native, i: int) -> dict[str, float]:
    """Parameters of the injector in a lane; the pipe's length gives its waves a delay of their own."""
    own = dict(zip(native.parameters, native.vector(), strict=True))
    changed = {
        "nozzle.hole_diameter": 1.0 + 0.01 * i,
        "feed_pipe.length": 1.0 - 0.03 * i,
        "valve.mass": 1.0 + 0.02 * i,
    }
    return {name: own[name] * factor for name, factor in changed.items()}


def failing(native: Native) -> dict[str, float]:
    """Parameters with which a step of 1 us is short enough at rest, and too long once the needle has risen."""
    own, short = native.vector()[native.parameters.index("control_chamber.volume")], 0.0
    enough = own
    for _ in range(40):
        middle = 0.5 * (short + enough)
        if Run(native, BOUNDARIES[1], values={"control_chamber.volume": middle}).status:
            short = middle
        else:
            enough = middle
    return {"control_chamber.volume": 1.001 * enough}


@pytest.fixture(params=WIDTHS)
def width(request: pytest.FixtureRequest, native: Native) -> int:
    """Lanes that are computed at once."""
    if request.param > native.vectors():
        pytest.skip(f"this processor has no vectors of {request.param} numbers")
    return int(request.param)


def test_eight_injectors_are_those_that_they_are_alone(native: Native, width: int) -> None:
    """To the last bit: nothing is fused or reordered, in vectors neither."""
    values = [values_of(native, i) for i in range(8)]
    block = BlockRun(native, BOUNDARIES, values, width)
    alone = [Run(native, BOUNDARIES[i], values=values[i]) for i in range(8)]
    assert [block.status, native.block_vectors(block.block), native.block_count(block.block)] == [0, width, 8]
    for i in range(8):
        assert block.plan(i, *TRAINS[i]) == alone[i].plan(*TRAINS[i]) == 0
    for _ in range(STEPS // 10):
        assert block.march(10) == 0
        for i in range(8):
            alone[i].march(10)
            assert block.observe(i) == alone[i].observe()
    figures = [block.figures(i) for i in range(8)]
    assert len({one.injected for one in figures}) == 8
    assert min(one.injected for one in figures) > 1e-6
    for i, run in enumerate(alone):
        for name in ("opening", "first_closing", "returned", "greatest_lift", "reference_density"):
            np.testing.assert_equal(getattr(figures[i], name), getattr(run.figures(), name), err_msg=name)
        assert native.block_status(block.block, i) == native.status(run.state)


def test_one_that_fails_stands_still_and_the_others_go_on(native: Native, width: int) -> None:
    values = [{}, failing(native), {}]
    block = BlockRun(native, BOUNDARIES[:3], values, width)
    alone = [Run(native, BOUNDARIES[i], values=values[i]) for i in range(3)]
    for i, run in enumerate(alone):
        block.plan(i, (0.0, 500e-6))
        run.plan((0.0, 500e-6))
        run.march(1000)
    assert block.march(1000) == Status.STEP_UNSTABLE
    assert [native.block_status(block.block, i) for i in range(3)] == [native.status(run.state) for run in alone]
    for i, run in enumerate(alone):
        assert block.observe(i) == run.observe()
    assert block.figures(0).injected > 1e-6
    assert native.block_time(block.block) == pytest.approx(1e-3)


def test_inputs_of_each_step_and_switches_are_those_of_one_alone(native: Native, width: int) -> None:
    rng = np.random.default_rng(5)
    block, given = (BlockRun(native, BOUNDARIES[:5], vectors=width) for _ in range(2))
    alone = [Run(native, one) for one in BOUNDARIES[:5]]
    for i, run in enumerate(alone):
        assert native.block_switch(block.block, i, i * 1e-6, 1) == native.switch(run.state, i * 1e-6, 1) == 0
    block.march(400)
    assert native.block_switch(block.block, 0, 100e-6, 0) == 17  # in the past
    for i, run in enumerate(alone):
        run.march(400)
        assert native.block_switch(block.block, i, 410.5e-6, 0) == native.switch(run.state, 410.5e-6, 0) == 0
        run.march(200)
    block.march(200)
    for i, run in enumerate(alone):
        assert block.figures(i).injected == run.figures().injected
    # measured courses: five pressures that move, in calls of an odd number of steps
    inputs = np.zeros((600, 5, 6))
    inputs[:, :, :3] = [one[:3] for one in BOUNDARIES[:5]]
    inputs[:, :, 0] += 1e6 * rng.standard_normal((600, 5)).cumsum(axis=0) / 25.0
    inputs[:, :, 4] = 1e-6 * np.arange(600)[:, None] - 1e-6 * np.arange(5)
    inputs[:, :, 5] = inputs[:, :, 4] - 400e-6
    alone = [Run(native, one) for one in BOUNDARIES[:5]]
    for first in range(0, 600, 75):
        assert given.march_inputs(inputs[first : first + 75]) == 0
    for i, run in enumerate(alone):
        run.march_inputs(inputs[:, i])
        assert given.figures(i).injected == run.figures().injected
        assert given.observe(i)["rail_pressure"] == inputs[-1, i, 0]


def test_a_kept_block_comes_back_with_the_same_bits(native: Native, width: int) -> None:
    block = BlockRun(native, BOUNDARIES[:4], vectors=width)
    for i in range(4):
        block.plan(i, *TRAINS[i])
    block.march(333)
    kept = block.memory.copy()
    block.march(500)
    again = BlockRun(native, BOUNDARIES[:4], vectors=width)
    again.memory[:] = kept
    again.march(500)
    assert again.memory.tobytes() == block.memory.tobytes()


def test_misuse_of_a_block_is_refused(native: Native) -> None:
    block = BlockRun(native, BOUNDARIES[:2])
    assert block.plan(2, (0.0, 500e-6)) == 18  # there are two
    assert native.block_status(block.block, -1) == 18
    foreign = np.zeros(len(block.memory))
    assert native.block_march(foreign.ctypes.data, 1, block.boundaries) == 18
    assert native.block_count(foreign.ctypes.data) == native.block_vectors(foreign.ctypes.data) == 0
    assert math.isnan(native.block_time(foreign.ctypes.data))
    arguments = (block.theta, block.boundaries, 2, 0, 1e-6, 0.0)
    assert native.block_begin(block.block, block.size - 1, *arguments) == 18
    assert native.block_begin(None, block.size, *arguments) == 18
    # nine injectors, none, a parameter outside its domain, no boundaries, one that cannot be
    assert [native.block_size(block.theta, count, 1e-6) for count in (0, 9)] == [0, 0]
    assert BlockRun(native, BOUNDARIES[:2], [{}, {"valve.mass": 0.0}]).status == Status.OUTSIDE_DOMAIN
    assert native.block_begin(block.block, block.size, block.theta, None, 2, 0, 1e-6, 0.0) == 16
    block.boundaries[1].cylinder_pressure = 170e6
    assert native.block_march(block.block, 1, block.boundaries) == 16


def test_the_memory_of_a_block_is_what_is_said(native: Native, width: int) -> None:
    """Numbers behind the end of a block keep their values."""
    block = BlockRun(native, BOUNDARIES[:3], [values_of(native, i) for i in range(3)], width)
    room = np.full(block.size // 8 + 64, 7.0)
    arguments = (room.ctypes.data, block.size, block.theta, block.boundaries, 3, width, 1e-6, 0.0)
    assert native.block_begin(*arguments) == 0
    native.block_march(room.ctypes.data, 500, block.boundaries)
    native.block_observe(room.ctypes.data, 2, (ctypes.c_double * len(native.channels))())
    assert np.all(room[block.size // 8 :] == 7.0)
