"""FMU of a model: a ZIP of its description, one binary for each platform, sources, documentation."""

from __future__ import annotations

import os
import struct
import tempfile
import zipfile
import zlib
from collections.abc import Sequence
from html import escape
from importlib.metadata import version
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from commonrail.base.errors import ConfigurationError
from commonrail.base.hooks import ALL_ENTRIES, lasting
from commonrail.engine.time_step import DEFAULT_STEP
from commonrail.physics.injector import Injector
from commonrail.physics.variants import DRIVE, unread_inputs
from commonrail.physics.variants import RAIL as RAIL_INPUT
from commonrail.physics.variants import RETURN as BACK
from commonrail.plugins.export.description import (
    CYLINDER,
    RAIL,
    RETURN,
    Variable,
    build_description,
    describe2,
    describe3,
    terminals,
    variables,
)
from commonrail.plugins.export.library import write_sources
from commonrail.plugins.export.objects import Compiler, Target, compiler_for, emit, link_shared
from commonrail.plugins.export.sources import Model, model_of, named, template

# Page inside an FMU: what it is, its variables, its limits.

_STYLE = (
    "body{font:15px/1.5 system-ui,sans-serif;max-width:70rem;margin:2rem auto;padding:0 1rem}"
    "table{border-collapse:collapse}td,th{padding:.2rem .6rem;border-bottom:1px solid #8884;text-align:left}"
)
_TEXT = (
    "Set the pressures of the boundaries and, before the initialization, any parameter. Energise the solenoid by the "
    "Boolean input command, or plan up to four energisings by the parameters energising[i]; do not mix the two.",
    "All numbers are in SI units; display units are bar, mg, um and us. The inner time step is time_step. Any "
    "communication step is possible: outputs are those of the last inner step that has been completed, inputs are held "
    "over a communication step, and edges of command fall on communication points to the exact time.",
    "A simulation that fails (a parameter outside its domain, a time step that is too long, pressures that the fuel "
    "does not cover) says so in one sentence to the logger, and the step is discarded.",
)


def documentation_page(model: Model, listed: Sequence[Variable]) -> str:
    """HTML text.

    Parameters
    ----------
    model : Model
    listed : sequence of Variable
    """
    injector = model.injector
    notes = [f"Not measured: {injector.synthetic}"] if injector.synthetic else []
    low, high = (1e-6 * p for p in injector.fuel.pressure_range)
    coldest, hottest = injector.fuel.temperature_range
    notes += [
        f"Wiring: {injector.wired().label}.",
        f"Fuel: {injector.fuel.title}, from {low:g} to {high:g} MPa and {coldest:g} to {hottest:g} K.",
        "Values that were fitted to bench data hold for the operating points of that bench.",
    ]
    paragraphs = "".join(f"<p>{escape(text)}</p>" for text in (*_TEXT, *notes))
    head = "<tr><th>variable</th><th>kind</th><th>unit</th><th>start</th><th>meaning</th></tr>"
    rows = "".join(
        f"<tr><td>{escape(v.name)}</td><td>{v.kind.causality}</td><td>{escape(v.unit)}</td>"
        f"<td>{'' if v.start is None else f'{v.start:.6g}'}</td><td>{escape(v.meaning)}</td></tr>"
        for v in listed
    )
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{escape(injector.name)}</title>'
        f"<style>{_STYLE}</style><h1>{escape(injector.name)}</h1><p>{escape(injector.title)}</p>{paragraphs}"
        f"<table>{head}{rows}</table><p>Written by commonrail {escape(version('commonrail'))}.</p></html>\n"
    )


# Icon of an exported model: an injector nozzle with its needle and a spray, drawn here as a PNG.

SIZE = 64
INK, NEEDLE, SPRAY, PAPER = (29, 39, 51), (193, 39, 45), (0, 121, 180), (255, 255, 255)


def icon_png() -> bytes:
    """PNG of `SIZE` by `SIZE` points in true colour; the same bytes each time."""
    rows = b"".join(b"\0" + row.tobytes() for row in _drawn())
    header = struct.pack(">IIBBBBB", SIZE, SIZE, 8, 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n" + _chunk(b"IHDR", header) + _chunk(b"IDAT", zlib.compress(rows, 9)) + _chunk(b"IEND", b"")
    )


def _drawn() -> NDArray[np.uint8]:
    """Points (rows, columns, colours)."""
    y, x = np.mgrid[0:SIZE, 0:SIZE]
    across = np.abs(x - (SIZE - 1) / 2.0)
    half = np.where(y < 26, 13.0, np.clip(13.0 - 0.5 * (y - 26), 5.0, None))  # of the body, which ends in a cone
    picture = np.full((SIZE, SIZE, 3), PAPER, np.uint8)
    picture[(across <= half) & (y >= 3) & (y < 44)] = INK
    picture[(across <= half - 4.0) & (y >= 3) & (y < 40)] = PAPER
    picture[(across <= np.clip(4.0 - 0.5 * np.clip(y - 34, 0, None), 0.0, None)) & (y >= 3) & (y < 42)] = NEEDLE
    angle = np.arctan2(across, y - 42.0)
    for middle in (0.25, 0.85):
        picture[(np.abs(angle - middle) < 0.1) & (y >= 46) & (np.hypot(across, y - 42.0) < 20.0)] = SPRAY
    return picture


def _chunk(kind: bytes, content: bytes) -> bytes:
    checked = kind + content
    return struct.pack(">I", len(content)) + checked + struct.pack(">I", zlib.crc32(checked))


_HEADERS = {
    2: ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"),
    3: ("fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h"),
}
_DESCRIPTIONS = {2: describe2, 3: describe3}
# Date of the files in the ZIP: equal FMUs have equal bytes but for the date in the description.
_WHEN = (1980, 1, 1, 0, 0, 0)


@lasting(ALL_ENTRIES)
def write_fmu(injector: Injector, out: Path, targets: Sequence[Target], fmi: int = 2) -> tuple[str, ...]:
    """Write an injector as an FMU for co-simulation.

    Parameters
    ----------
    injector : Injector
        Its values are the start values.
    out : Path
    targets : sequence of Target
        Platforms of the binaries.
    fmi : int
        Version of the standard, 2 or 3.

    Returns
    -------
    tuple of str
        Names of the files in it.

    Raises
    ------
    ConfigurationError
        If the standard knows no such platform, there is no compiler for one, or it fails.
    """
    check_fmi(fmi)
    folders = {target.name: _folder(target, fmi) for target in targets}
    compilers = {target.name: compiler_for(target, prefer_zig=True) for target in targets}
    model = model_of(injector)
    token = f"{{{model.stamp[:8]}-{model.stamp[8:12]}-{model.stamp[12:16]}-{model.stamp[16:20]}-{model.stamp[20:32]}}}"
    listed = variables(injector)
    with tempfile.TemporaryDirectory(prefix="commonrail-") as temporary:
        folder = Path(temporary)
        written = [*write_sources(model, folder), *_write_instance(model, folder, token, fmi)]
        to_compile = [path.name for path in written if path.suffix == ".c"]
        describe = _DESCRIPTIONS[fmi]
        contents = {"modelDescription.xml": describe(model, listed, token, to_compile).encode()}
        for target in targets:
            binary = folder / f"{target.name}{target.suffix}"
            _link(compilers[target.name], model, folder, binary, target)
            contents[f"binaries/{folders[target.name]}/{model.name}{target.suffix}"] = binary.read_bytes()
        contents |= {f"sources/{path.name}": path.read_bytes() for path in written}
    contents["model.png" if fmi == 2 else "terminalsAndIcons/icon.png"] = icon_png()
    if fmi == 3:
        contents["sources/buildDescription.xml"] = build_description(model, to_compile).encode()
        contents["terminalsAndIcons/terminalsAndIcons.xml"] = terminals(listed).encode()
    contents["documentation/index.html"] = documentation_page(model, listed).encode()
    contents["documentation/licenses/notices.txt"] = template("notices.txt").replace("NAME", model.name).encode()
    _pack(out, contents)
    return tuple(contents)


def _link(compiler: Compiler, model: Model, folder: Path, binary: Path, target: Target) -> None:
    """Link the binary of a target: the C around the physics, and the physics as LLVM compiles it."""
    kernel = folder / f"{target.name}.o"
    kernel.write_bytes(emit(model.injector.wired(), target, model.name))
    around = sorted(path for path in folder.glob("*.c") if path.stem != f"{model.name}_kernel")
    link_shared(compiler, (*around, kernel), binary, target, ())


def check_fmi(version: int) -> None:
    """Refuse a version of the standard that is not written.

    Raises
    ------
    ConfigurationError
    """
    if version not in _HEADERS:
        known = " and ".join(map(str, _HEADERS))
        raise ConfigurationError(f"FMUs are written for version {known} of the FMI standard, not {version}.")


def _folder(target: Target, fmi: int) -> str:
    folder = target.fmi2 if fmi == 2 else target.fmi3
    if not folder:
        raise ConfigurationError(
            f"FMI {fmi}.0 has no folder for binaries of {target.name}; leave this platform out"
            + (", or write an FMU of version 3." if fmi == 2 and target.fmi3 else ".")
        )
    return folder


def _write_instance(model: Model, folder: Path, token: str, fmi: int) -> list[Path]:
    """Write the sources around the library that make it an FMU."""
    start = {"STEP": DEFAULT_STEP, "RAIL": RAIL, "CYLINDER": CYLINDER, "RETURN": RETURN}
    defines = [f'#define CR_GUID "{token}"', *(f"#define CR_FMU_{name} {value!r}" for name, value in start.items())]
    unread = unread_inputs(model.injector.variant)
    defines += [f"#define CR_FMU_READS_{name.upper()} {int(name not in unread)}" for name in (RAIL_INPUT, BACK, DRIVE)]
    header = template("fmu.h").replace("/*START*/", "\n".join(defines) + "\n")
    texts = {
        f"{model.name}_fmu.h": header,
        f"{model.name}_fmu.c": template("fmu.c"),
        f"{model.name}_fmi{fmi}.c": template(f"fmi{fmi}.c"),
    }
    for name, text in texts.items():
        (folder / name).write_text(named(text, model.name), encoding="utf-8")
    for name in _HEADERS[fmi]:
        (folder / name).write_text(template(f"fmi/{name}"), encoding="utf-8")
    return [folder / name for name in (*texts, *_HEADERS[fmi])]


def _pack(out: Path, contents: dict[str, bytes]) -> None:
    """Write the ZIP; a file of that name is replaced once the new one is complete."""
    handle, name = tempfile.mkstemp(dir=out.parent, prefix=f".{out.name}.")
    try:
        with os.fdopen(handle, "wb") as stream, zipfile.ZipFile(stream, "w", compresslevel=9) as archive:
            for path, content in contents.items():
                entry = zipfile.ZipInfo(path, _WHEN)
                entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
                archive.writestr(entry, content)
        os.chmod(name, 0o644)
        os.replace(name, out)
    except BaseException:
        os.unlink(name)
        raise
