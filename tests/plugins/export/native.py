"""An exported library as Python objects, by ctypes."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from ctypes import POINTER, Structure, byref, c_double, c_int, c_int64, c_size_t, c_void_p
from typing import Any

import numpy as np
from numpy.typing import NDArray

from commonrail.plugins.export.library import Library

Floats = NDArray[np.float64]


class Boundary(Structure):
    _fields_ = [(name, c_double) for name in ("rail_pressure", "cylinder_pressure", "return_pressure", "drive")]


class Energising(Structure):
    _fields_ = [("start", c_double), ("duration", c_double)]


_FIGURES = (
    *("injected", "returned", "supplied", "opening", "closing", "first_closing"),
    *("greatest_lift", "reference_density"),
)


class Figures(Structure):
    _fields_ = [(name, c_double) for name in _FIGURES]


class Native:
    """Functions of a library."""

    def __init__(self, library: Library, target: str) -> None:
        self.name = library.model.name
        self.dll = ctypes.CDLL(str(library.shared[target]))
        doubles = POINTER(c_double)
        kinds: dict[str, tuple[Any, list[Any]]] = {
            "parameter_name": (ctypes.c_char_p, [c_int]),
            "parameter_index": (c_int, [ctypes.c_char_p]),
            "channel_name": (ctypes.c_char_p, [c_int]),
            "defaults": (None, [doubles]),
            "check": (c_int, [doubles, POINTER(Boundary), c_double, POINTER(c_int)]),
            "longest_step": (c_double, [doubles, POINTER(Boundary)]),
            "state_size": (c_size_t, [doubles, c_double]),
            "begin": (c_int, [c_void_p, c_size_t, doubles, POINTER(Boundary), c_double, c_double]),
            "plan": (c_int, [c_void_p, POINTER(Energising), c_int]),
            "switch": (c_int, [c_void_p, c_double, c_int]),
            "march": (c_int, [c_void_p, c_int64, POINTER(Boundary)]),
            "march_inputs": (c_int, [c_void_p, c_int64, doubles]),
            "time": (c_double, [c_void_p]),
            "status": (c_int, [c_void_p]),
            "sentence": (ctypes.c_char_p, [c_int]),
            "observe": (None, [c_void_p, doubles]),
            "read_figures": (None, [c_void_p, POINTER(Figures)]),
            "vectors": (c_int, []),
            "block_size": (c_size_t, [doubles, c_int, c_double]),
            "block_begin": (
                c_int,
                [c_void_p, c_size_t, doubles, POINTER(Boundary), c_int, c_int, c_double, c_double],
            ),
            "block_vectors": (c_int, [c_void_p]),
            "block_count": (c_int, [c_void_p]),
            "block_plan": (c_int, [c_void_p, c_int, POINTER(Energising), c_int]),
            "block_switch": (c_int, [c_void_p, c_int, c_double, c_int]),
            "block_march": (c_int, [c_void_p, c_int64, POINTER(Boundary)]),
            "block_march_inputs": (c_int, [c_void_p, c_int64, doubles]),
            "block_time": (c_double, [c_void_p]),
            "block_status": (c_int, [c_void_p, c_int]),
            "block_observe": (None, [c_void_p, c_int, doubles]),
            "block_read_figures": (None, [c_void_p, c_int, POINTER(Figures)]),
        }
        for name, (result, arguments) in kinds.items():
            function = getattr(self.dll, f"{self.name}_{name}")
            function.restype, function.argtypes = result, arguments
            setattr(self, name, function)
        self.parameters = _names(self.parameter_name)
        self.channels = _names(self.channel_name)

    def vector(self, values: Mapping[str, float] | None = None) -> Any:
        """Parameters: the model's own, some of them changed."""
        found = (c_double * len(self.parameters))()
        self.defaults(found)
        for name, value in (values or {}).items():
            found[self.parameters.index(name)] = value
        return found


def _names(function: Any) -> list[str]:
    found: list[str] = []
    while (name := function(len(found))) is not None:
        found.append(name.decode())
    return found


class Run:
    """One simulation in memory of its own."""

    def __init__(
        self,
        native: Native,
        boundary: Sequence[float],
        step: float = 1e-6,
        values: Mapping[str, float] | None = None,
        start: float = 0.0,
    ) -> None:
        self.native, self.boundary = native, Boundary(*boundary)
        theta = native.vector(values)
        size = native.state_size(theta, step)
        self.memory = np.zeros(max(size // 8, 1))
        self.state = self.memory.ctypes.data
        self.status = native.begin(self.state, size, theta, byref(self.boundary), step, start)

    def plan(self, *energisings: tuple[float, float]) -> int:
        """Plan energisings (start, duration)."""
        table = (Energising * len(energisings))(*(Energising(*one) for one in energisings))
        return int(self.native.plan(self.state, table, len(energisings)))

    def march(self, steps: int) -> int:
        """March some steps."""
        return int(self.native.march(self.state, steps, byref(self.boundary)))

    def march_inputs(self, inputs: Floats) -> int:
        """March with the inputs of each step, (steps, 6)."""
        rows = np.ascontiguousarray(inputs)
        return int(self.native.march_inputs(self.state, len(rows), rows.ctypes.data_as(POINTER(c_double))))

    def observe(self) -> dict[str, float]:
        """Present channels by name."""
        out = (c_double * len(self.native.channels))()
        self.native.observe(self.state, out)
        return dict(zip(self.native.channels, out, strict=True))

    def figures(self) -> Figures:
        """Figures so far."""
        found = Figures()
        self.native.read_figures(self.state, byref(found))
        return found

    def courses(self, steps: int) -> dict[str, Floats]:
        """Channels at the start and after each of some steps."""
        rows = [self.observe()]
        for _ in range(steps):
            self.march(1)
            rows.append(self.observe())
        return {name: np.array([row[name] for row in rows]) for name in rows[0]}


class BlockRun:
    """Injectors side by side in a block of their own memory.

    Parameters
    ----------
    native : Native
    boundaries : sequence of sequences of float
        Fields of `Boundary` of each injector.
    values : sequence of mappings of str to float, optional
        Parameters of each that are not the model's own.
    vectors : int
        Lanes that are computed at once, at most; 0: as many as the processor has.
    step : float
        [s].
    """

    def __init__(
        self,
        native: Native,
        boundaries: Sequence[Sequence[float]],
        values: Sequence[Mapping[str, float]] | None = None,
        vectors: int = 0,
        step: float = 1e-6,
    ) -> None:
        self.native, self.count = native, len(boundaries)
        self.boundaries = (Boundary * self.count)(*(Boundary(*one) for one in boundaries))
        rows = [np.array(native.vector(one)) for one in values or [{}] * self.count]
        self.theta = np.ascontiguousarray(rows).ctypes.data_as(POINTER(c_double))
        self.size = native.block_size(self.theta, self.count, step)
        self.memory = np.zeros(max(self.size // 8, 1))
        self.block = self.memory.ctypes.data
        self.status = native.block_begin(
            self.block, self.size, self.theta, self.boundaries, self.count, vectors, step, 0.0
        )

    def plan(self, injector: int, *energisings: tuple[float, float]) -> int:
        """Plan energisings (start, duration) of one injector."""
        table = (Energising * len(energisings))(*(Energising(*one) for one in energisings))
        return int(self.native.block_plan(self.block, injector, table, len(energisings)))

    def march(self, steps: int) -> int:
        """March some steps."""
        return int(self.native.block_march(self.block, steps, self.boundaries))

    def march_inputs(self, inputs: Floats) -> int:
        """March with the inputs of each step, (steps, injectors, 6)."""
        rows = np.ascontiguousarray(inputs)
        return int(self.native.block_march_inputs(self.block, len(rows), rows.ctypes.data_as(POINTER(c_double))))

    def observe(self, injector: int) -> dict[str, float]:
        """Present channels of one injector by name."""
        out = (c_double * len(self.native.channels))()
        self.native.block_observe(self.block, injector, out)
        return dict(zip(self.native.channels, out, strict=True))

    def figures(self, injector: int) -> Figures:
        """Figures of one injector so far."""
        found = Figures()
        self.native.block_read_figures(self.block, injector, byref(found))
        return found
