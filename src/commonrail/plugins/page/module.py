"""WebAssembly module of a wiring: the compiled physics and a shim in C, made on demand and cached with the kernels."""

from __future__ import annotations

import hashlib
import tempfile
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from commonrail.compiler.cache import get_or_make
from commonrail.engine.job import make_rows
from commonrail.physics.variants import Variant
from commonrail.plugins.export import object_files
from commonrail.plugins.export.entry_points import sizes
from commonrail.plugins.export.object_files import compiler_for, emit, find_target, make_source, run_compiler

TARGET = "wasm32"
MOST_STEPS, MOST_ROWS, MOST_SLOTS = 60_000, 20_000, 16_384  # limits of a simulation, whose memory is part of the module
_SHIM = Path(__file__).with_name("page.c")
_FEATURES = "-mcpu=generic+simd128+bulk_memory+nontrapping_fptoint+sign_ext"
_LINK = ("-Wl,--no-entry", "-Wl,--strip-all", "-Wl,-z,stack-size=65536")
# Without a C library: what little is needed of one is in zig's own run-time library, which it builds in some seconds.
_BARE = "wasm32-freestanding"


def wasm_module(variant: Variant) -> bytes:
    """Module that simulates one injection a call; it imports nothing.

    ConfigurationError if neither a kept module nor zig is there, or a compiler fails.
    """
    return get_or_make(_file_name(variant), lambda: _link(variant))


def _file_name(variant: Variant) -> str:
    """File name from all inputs except the physics, which name the folder."""
    digest = hashlib.sha256(repr((make_source(variant).digest, _defines(variant), _zig())).encode())
    for source in (Path(object_files.__file__), _SHIM, Path(__file__)):
        digest.update(source.read_bytes())
    return f"{digest.hexdigest()[:24]}.wasm"


def _zig() -> str:
    try:
        return version("ziglang")
    except PackageNotFoundError:
        return ""


def _defines(variant: Variant) -> dict[str, int]:
    size, rows = sizes(variant), make_rows(variant, 1)
    return {
        "CR_COLUMNS": size.parameters + size.fuel,
        "CR_WORK": size.work,
        "CR_FIGURES": size.figures,
        "CR_CHANNELS": size.channels,
        "CR_INJECTED": int(rows.injected),
        "CR_TIP": int(rows.tip),
        "CR_VALVE": int(rows.valve_lift),
        "CR_STEPS": MOST_STEPS,
        "CR_ROWS": MOST_ROWS,
        "CR_SLOTS": MOST_SLOTS,
    }


def _link(variant: Variant) -> bytes:
    target = find_target(TARGET)
    compiler = compiler_for(target._replace(zig=_BARE))  # refuses before the physics is compiled
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        physics, out = folder / "physics.o", folder / "page.wasm"
        physics.write_bytes(emit(variant, target))
        defines = [f"-D{name}={value}" for name, value in _defines(variant).items()]
        inputs = [str(_SHIM), str(physics), "-o", str(out)]
        run_compiler([*compiler.command, "-O2", "-g0", _FEATURES, *_LINK, *defines, *inputs], folder)
        return out.read_bytes()
