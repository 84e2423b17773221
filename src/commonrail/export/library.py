"""Folder with a model as a C library: header, sources, objects, static and shared libraries, examples."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from commonrail.errors import InputError
from commonrail.export.entries import sizes
from commonrail.export.linker import archive, compile_source, compiler_for, link_shared
from commonrail.export.objects import Target, emit
from commonrail.export.sources import Model, model_of, named, template
from commonrail.injector.definition import Injector

__all__ = ["Library", "write_library", "write_sources"]

_EXAMPLES = ("example.c", "example.py")


class Library(NamedTuple):
    """Files of a library.

    Attributes
    ----------
    model : Model
    folder : Path
    shared : dict of str to Path
        Shared library of each target.
    files : tuple of Path
        All that was written.
    """

    model: Model
    folder: Path
    shared: dict[str, Path]
    files: tuple[Path, ...]


def write_library(injector: Injector, folder: Path, targets: Sequence[Target], prefer_zig: bool = False) -> Library:
    """Write an injector as a C library.

    Parameters
    ----------
    injector : Injector
    folder : Path
        Exists; files of the same names are replaced.
    targets : sequence of Target
        Each gets an object, a static and a shared library, WebAssembly the object alone; with more than one target,
        in folders by their names.
    prefer_zig : bool
        See `compiler_for`.

    Raises
    ------
    ConfigurationError
        If there is no compiler for a target, or it fails.
    InputError
        If files of the examples' names are there that no export has written.
    """
    _refuse_foreign_examples(folder)
    compilers = {target.name: compiler_for(target, prefer_zig) for target in targets if target.suffix != ".wasm"}
    model = model_of(injector)
    files = write_sources(model, folder)
    shared: dict[str, Path] = {}
    for target in targets:
        place = folder / target.name if len(targets) > 1 else folder
        place.mkdir(exist_ok=True)
        kernel = place / f"{model.name}_kernel_{target.name}.o"
        kernel.write_bytes(emit(injector.wired(), target, model.name))
        files += (kernel,)
        if target.name not in compilers:
            continue
        compiler = compilers[target.name]
        core = place / f"{model.name}.o"
        compile_source(compiler, folder / f"{model.name}.c", core, target)
        static, shared[target.name] = place / f"lib{model.name}.a", place / shared_name(model, target)
        archive(compiler, (core, kernel), static)
        core.unlink()
        link_shared(
            compiler,
            (folder / f"{model.name}.c", kernel),
            shared[target.name],
            target,
            (f"{model.name.upper()}_SHARED",),
        )
        files += (static, shared[target.name])
    files += _write_examples(model, folder)
    return Library(model, folder, shared, files)


def shared_name(model: Model, target: Target) -> str:
    """File name of a shared library."""
    return f"{'' if target.suffix == '.dll' else 'lib'}{model.name}{target.suffix}"


def write_sources(model: Model, folder: Path) -> tuple[Path, ...]:
    """Write header and sources of a model."""
    texts = {f"{model.name}.h": model.header, **model.sources}
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    return tuple(folder / name for name in texts)


def _refuse_foreign_examples(folder: Path) -> None:
    """Refuse a folder whose own example.c or example.py would be lost; an export has a kernel's source beside them."""
    foreign = [name for name in _EXAMPLES if (folder / name).exists() and not any(folder.glob("*_kernel.c"))]
    if foreign:
        raise InputError(f"{folder}: {' and '.join(foreign)} would be replaced; name a new folder.")


def _write_examples(model: Model, folder: Path) -> tuple[Path, ...]:
    size = sizes(model.injector.wired())
    in_c = named(template("example.c"), model.name).replace(" cr.c ", f" {model.name}.c ")
    in_python = named(template("example.py.in"), model.name)
    in_python = re.sub(
        r"PARAMETERS, CHANNELS = 0, 0", f"PARAMETERS, CHANNELS = {size.parameters + 1}, {size.channels}", in_python
    )
    for name, text in (("example.c", in_c), ("example.py", in_python)):
        (folder / name).write_text(text, encoding="utf-8")
    return folder / "example.c", folder / "example.py"
