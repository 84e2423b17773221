"""An FMU of version 2.0 by its own functions, without an importer: what tests ask of single calls."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from pathlib import Path

OK, DISCARD, ERROR = 0, 2, 3


class Binary:
    """Shared library of an FMU.

    Parameters
    ----------
    path : Path
    token : str
        GUID of its description.
    """

    def __init__(self, path: Path, token: str) -> None:
        self.dll, self.token = ctypes.CDLL(str(path)), token.encode()
        self.dll.fmi2Instantiate.restype = ctypes.c_void_p

    def instance(self) -> Instance:
        """A new instance."""
        found = self.dll.fmi2Instantiate(b"one", 1, self.token, None, None, None, None)
        assert found
        return Instance(self, ctypes.c_void_p(found))


class Instance:
    """Instance of the FMU; each method is one call and returns its status, or the values."""

    def __init__(self, binary: Binary, pointer: ctypes.c_void_p) -> None:
        self.binary, self.dll, self.pointer = binary, binary.dll, pointer

    def set(self, references: Sequence[int], values: Sequence[float]) -> int:
        """Set real variables."""
        n = len(references)
        return self.dll.fmi2SetReal(
            self.pointer, (ctypes.c_uint * n)(*references), ctypes.c_size_t(n), (ctypes.c_double * n)(*values)
        )

    def get(self, references: Sequence[int]) -> list[float]:
        """Values of real variables."""
        n = len(references)
        found = (ctypes.c_double * n)()
        assert self.dll.fmi2GetReal(self.pointer, (ctypes.c_uint * n)(*references), ctypes.c_size_t(n), found) == OK
        return list(found)

    def begin(self, start: float = 0.0) -> int:
        """Go through the initialization."""
        assert (
            self.dll.fmi2SetupExperiment(
                self.pointer, 0, ctypes.c_double(), ctypes.c_double(start), 0, ctypes.c_double()
            )
            == OK
        )
        assert self.dll.fmi2EnterInitializationMode(self.pointer) == OK
        return self.dll.fmi2ExitInitializationMode(self.pointer)

    def step(self, now: float, length: float) -> int:
        """Take a communication step."""
        return self.dll.fmi2DoStep(self.pointer, ctypes.c_double(now), ctypes.c_double(length), 1)

    def march(self, length: float, count: int, first: int = 0) -> None:
        """Take equal steps."""
        for k in range(first, first + count):
            assert self.step(k * length, length) == OK

    def reset(self) -> int:
        """Return to the state after the instantiation."""
        return self.dll.fmi2Reset(self.pointer)

    def terminate(self) -> int:
        """End the simulation."""
        return self.dll.fmi2Terminate(self.pointer)

    def free(self) -> None:
        """Free the instance."""
        self.dll.fmi2FreeInstance(self.pointer)

    def serialised(self) -> bytes:
        """State as bytes."""
        state, size = ctypes.c_void_p(), ctypes.c_size_t()
        assert self.dll.fmi2GetFMUstate(self.pointer, ctypes.byref(state)) == OK
        assert self.dll.fmi2SerializedFMUstateSize(self.pointer, state, ctypes.byref(size)) == OK
        content = ctypes.create_string_buffer(size.value)
        assert self.dll.fmi2SerializeFMUstate(self.pointer, state, content, size) == OK
        assert self.dll.fmi2FreeFMUstate(self.pointer, ctypes.byref(state)) == OK
        return content.raw

    def restore(self, content: bytes) -> int:
        """Take up a state; the status of the call that refuses it, if one does."""
        state = ctypes.c_void_p()
        status = self.dll.fmi2DeSerializeFMUstate(
            self.pointer, content, ctypes.c_size_t(len(content)), ctypes.byref(state)
        )
        if status == OK:
            status = self.dll.fmi2SetFMUstate(self.pointer, state)
            self.dll.fmi2FreeFMUstate(self.pointer, ctypes.byref(state))
        return status
