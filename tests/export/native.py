"""An exported library as Python objects, by ctypes."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from ctypes import POINTER, Structure, byref, c_double, c_int, c_int64, c_size_t, c_void_p
from typing import Any

import numpy as np
from numpy.typing import NDArray

from commonrail.export.library import Library

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
