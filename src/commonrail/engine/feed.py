"""Inputs of a block in each step: waves that arrive from its rings, boundary pressures, clocks of the drive."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from commonrail.engine.recorder import at
from commonrail.physics.law import physics

Law = Callable[..., Any]

NEVER = 1 << 62  # step of a turn that is not reached


class Memory(NamedTuple):
    """Memory of a block."""

    work: Any  # (rows × lanes,)
    waves: Any  # (3 × ring × lanes,): rings of the three waves
    ring: int  # slots of a ring


class ClockedMemory(NamedTuple):
    """`Memory` with the origins of the clocks [s], (2 × lanes,) in double precision."""

    work: Any
    waves: Any
    ring: int
    origins: Any


@physics
def fill_rings(memory, rows):  # type: ignore[no-untyped-def]
    """Fill the rings with the waves of rest, and set the delays; true if those of all lanes are alike."""
    work, waves, ring = memory.work, memory.waves, memory.ring
    for wave in range(3):
        for slot in range(ring):
            for lane in range(rows.lanes):
                waves[at(rows, wave * ring + slot, lane)] = work[at(rows, rows.leaving + wave, lane)]
    alike = True
    for wave in range(3):
        row = rows.feed_delay if wave < 2 else rows.back_delay
        for lane in range(rows.lanes):
            work[at(rows, rows.arriving + wave, lane)] = work[at(rows, rows.leaving + wave, lane)]
            delay = min(max(work[at(rows, row, lane)], 1.0), ring - 2.0)
            work[at(rows, rows.delay_steps + wave, lane)] = float(int(delay))
            work[at(rows, rows.delay_fraction + wave, lane)] = delay - int(delay)
            alike = alike and work[at(rows, row, lane)] == work[at(rows, row, 0)]
    return alike


@physics
def arrived(work, rows, wave, lane):  # type: ignore[no-untyped-def]
    """A wave that arrives: between the two slots of its ring that `arrive` has put side by side."""
    part = work[at(rows, rows.delay_fraction + wave, lane)]
    late, later = work[at(rows, rows.arriving + wave, lane)], work[at(rows, rows.arriving_before + wave, lane)]
    return (1.0 - part) * late + part * later


@physics
def copy_number(target, to, source, first):  # type: ignore[no-untyped-def]
    """A row of one lane."""
    target[to] = source[first]


@physics
def gather_number(target, to, source, where):  # type: ignore[no-untyped-def]
    """A row of one lane from a slot of its ring."""
    place, first, now, mask = where
    target[to] = source[first + ((now - int(target[place])) & mask)]


def make_wave_transport(rows: Any, copy: Law, gather: Law = gather_number) -> tuple[Law, Law]:
    """Functions that bring the waves that arrive in step k, and take those that leave, from and into their rings.

    `copy` (function (target, to, source, first)): copies a row; `gather`: as `registers.row_gatherer`; needed for
    several lanes.
    """

    @physics
    def arrive(memory, k, alike):  # type: ignore[no-untyped-def]
        # slots k − delay and k − delay − 1, which was the first one a step ago; lanes whose delays are the same find
        # theirs in one row
        work, waves, ring = memory.work, memory.waves, memory.ring
        mask = ring - 1
        for wave in range(3):
            late, place = at(rows, rows.arriving + wave, 0), at(rows, rows.delay_steps + wave, 0)
            copy(work, at(rows, rows.arriving_before + wave, 0), work, late)
            if alike:
                copy(work, late, waves, at(rows, wave * ring + ((k - int(work[place])) & mask), 0))
            else:
                gather(work, late, waves, (place, wave * ring, k, mask))

    @physics
    def leave(memory, k):  # type: ignore[no-untyped-def]
        work, waves, ring = memory.work, memory.waves, memory.ring
        for wave in range(3):
            copy(waves, at(rows, wave * ring + (k & (ring - 1)), 0), work, at(rows, rows.leaving + wave, 0))

    return arrive, leave


class Inlets(NamedTuple):
    """Laws that set the inputs of a block, rows of `work`; in a step only `every_step` is called as a rule."""

    row: Law  # function (courses, points) that gives the row of the table which `every_step` reads
    every_step: Law  # function (memory, courses, row, k) that sets the inputs of step k
    # function (memory, courses, points, k) that turns clocks, and returns the step of the next turn of any lane
    turn: Law
    follow: Law  # function (memory, courses, points, k) that sets what follows a trace
    traced: Law  # function (courses, points) that tells if any lane follows one
    first: int  # step of the first turn; negative where there is none


def make_clocks(rows: Any, read: Law) -> Inlets:
    """Inlets from `Courses`; `read`: as `registers.clock_reader`."""

    @physics
    def clock_of(courses, points):  # type: ignore[no-untyped-def]
        return courses.clock[points[0]]

    @physics
    def tell_time(memory, courses, row, k):  # type: ignore[no-untyped-def]
        now = courses.times[row, k]
        read(memory.work, at(rows, rows.since_start, 0), memory.origins, 0, now)
        read(memory.work, at(rows, rows.since_end, 0), memory.origins, rows.lanes, now)

    @physics
    def turn(memory, courses, points, k):  # type: ignore[no-untyped-def]
        work, origins, due = memory.work, memory.origins, NEVER
        for lane in range(rows.lanes):
            here = courses.first[points[lane]] + int(work[at(rows, rows.clock_turns, lane)])
            if courses.turns[here] == k:
                origins[lane], origins[rows.lanes + lane] = courses.origins[here, 0], courses.origins[here, 1]
                work[at(rows, rows.since_start, lane)] = courses.origins[here, 2]
                work[at(rows, rows.since_end, lane)] = courses.origins[here, 3]
                work[at(rows, rows.clock_turns, lane)] += 1.0
                here += 1
            due = min(due, courses.turns[here])
        return due

    @physics
    def follow(memory, courses, points, k):  # type: ignore[no-untyped-def]
        work = memory.work
        for lane in range(rows.lanes):
            trace = courses.trace[points[lane]]
            if trace >= 0:
                for i in range(4):
                    work[at(rows, rows.inputs + i, lane)] = courses.traces[trace, k, i]

    @physics
    def traced(courses, points):  # type: ignore[no-untyped-def]
        found = False
        for lane in range(rows.lanes):
            found = found or courses.trace[points[lane]] >= 0
        return found

    return Inlets(clock_of, tell_time, turn, follow, traced, 0)
