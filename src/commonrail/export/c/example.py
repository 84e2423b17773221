"""One injection through the shared library, with nothing but Python's own ctypes."""

import ctypes
from ctypes import POINTER, Structure, byref, c_double, c_int, c_int64, c_size_t, c_void_p
from pathlib import Path

HERE = Path(__file__).resolve().parent
PARAMETERS, CHANNELS = 0, 0


class Boundary(Structure):
    _fields_ = [(name, c_double) for name in ("rail_pressure", "cylinder_pressure", "return_pressure", "drive")]


class Energising(Structure):
    _fields_ = [("start", c_double), ("duration", c_double)]


def main() -> None:
    library = ctypes.CDLL(str(next(HERE.glob("*cr.so"))))
    library.cr_state_size.restype = c_size_t
    library.cr_state_size.argtypes = [POINTER(c_double), c_double]
    library.cr_begin.argtypes = [c_void_p, c_size_t, POINTER(c_double), POINTER(Boundary), c_double, c_double]
    library.cr_plan.argtypes = [c_void_p, POINTER(Energising), c_int]
    library.cr_march.argtypes = [c_void_p, c_int64, POINTER(Boundary)]
    library.cr_observe.argtypes = [c_void_p, POINTER(c_double)]
    library.cr_status.argtypes = [c_void_p]
    library.cr_sentence.restype = ctypes.c_char_p
    parameters, channels = (c_double * PARAMETERS)(), (c_double * CHANNELS)()
    library.cr_defaults(parameters)
    size = library.cr_state_size(parameters, 1e-6)
    state = ctypes.create_string_buffer(size)
    boundary = Boundary(160e6, 5e6, 0.5e6, 0.0)
    status = library.cr_begin(state, size, parameters, byref(boundary), 1e-6, 0.0)
    status = status or library.cr_plan(state, byref(Energising(0.0, 700e-6)), 1)
    for k in range(300):
        status = status or library.cr_march(state, 10, byref(boundary))
        library.cr_observe(state, channels)
        print(f"{(k + 1) * 10} us: injected {channels[0] * 1e6:.3f} mg, needle lift {channels[3] * 1e6:.1f} um")
    print(library.cr_sentence(status or library.cr_status(state)).decode())


if __name__ == "__main__":
    main()
