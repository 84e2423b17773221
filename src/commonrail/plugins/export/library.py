"""Folder with a model as a C library: header, sources, objects, static and shared libraries, examples."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import NamedTuple

from commonrail.base.errors import InputError
from commonrail.base.hooks import ALL_ENTRIES, lasting
from commonrail.physics.injector import Injector
from commonrail.plugins.export import object_files
from commonrail.plugins.export.entry_points import LANES, sizes
from commonrail.plugins.export.object_files import Compiler, Target, compiler_for, list_vectors
from commonrail.plugins.export.sources import Model, insert_model_name, make_model, template

# Folder in which files appear only when all are complete.


@contextmanager
def place_when_complete(folder: Path) -> Iterator[Path]:
    """Give an empty folder to write into; if the block ends without an error, its files move to `folder`.

    A new folder, with its parents, appears in one step. In an existing folder, each file replaces the file of its name,
    and other files stay. An error changes nothing.
    """
    exists = folder.exists()
    if not exists:
        folder.parent.mkdir(parents=True, exist_ok=True)
    temporary = Path(tempfile.mkdtemp(prefix=".commonrail-", dir=folder if exists else folder.parent))
    staging = temporary / "made"  # has the permissions of a new folder
    staging.mkdir()
    try:
        yield staging
        if exists:
            for path in filter(Path.is_file, sorted(staging.rglob("*"))):
                target = folder / path.relative_to(staging)
                target.parent.mkdir(parents=True, exist_ok=True)
                os.replace(path, target)
        else:
            os.rename(staging, folder)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


# Sources of examples, and the names of their files.
_EXAMPLES = {name: name.removesuffix(".in") for name in ("example.c", "example.cpp", "example.jl", "example.py.in")}


class Library(NamedTuple):
    """Files of a library: the shared library of each target by name, and all written files."""

    model: Model
    folder: Path
    shared: dict[str, Path]
    files: tuple[Path, ...]


@lasting(ALL_ENTRIES)
def write_library(injector: Injector, folder: Path, targets: Sequence[Target]) -> Library:
    """Write an injector as a C library; nothing is changed before all of it is complete.

    Each target gets objects, a static and a shared library (WebAssembly one object), with more than one target in
    folders by name. Files of the same names are replaced. `ConfigurationError` if a compiler is missing
    or fails; `InputError` if files with the names of examples exist that no export has written.
    """
    return write_library_with(partial(make_model, injector), {}, folder, targets)


def write_library_with(
    make: Callable[[], Model], more: Mapping[str, str], folder: Path, targets: Sequence[Target]
) -> Library:
    """Write a library like `write_library` for the model that `make` gives, with more in it.

    `more`: texts of further headers and sources by file name, with ``cr`` in place of the model's name; they become
    part of the libraries.
    """
    foreign = [name for name in _EXAMPLES.values() if (folder / name).exists()]
    if foreign and not any(folder.glob("*_kernel.c")):  # an earlier export also has a kernel source
        raise InputError(f"{folder}: {' and '.join(foreign)} would be replaced; name a new folder.")
    compilers = {target.name: compiler_for(target) for target in targets if target.suffix != ".wasm"}
    model = make()
    shared: dict[str, Path] = {}
    with place_when_complete(folder) as staging:
        files = [*write_sources(model, staging), *write_around(model, staging, block_texts() | dict(more))]
        for target in targets:
            place = staging / target.name if len(targets) > 1 else staging
            place.mkdir(exist_ok=True)
            if target.name not in compilers:
                files += write_kernels(model, place, target, ())
                continue
            written = _write_binaries(model, staging, place, target, compilers[target.name])
            shared[target.name] = written[-1]
            files += written
        files += _write_examples(model, staging, "PLATFORM/" if len(targets) > 1 else "")
    moved = {path: folder / path.relative_to(staging) for path in files}
    return Library(model, folder, {name: moved[path] for name, path in shared.items()}, tuple(moved.values()))


def write_kernels(model: Model, place: Path, target: Target, vectors: Sequence[str]) -> list[Path]:
    """Write the object file of the compiled physics, then one for blocks per name in `vectors`."""
    name, wired = model.name, model.injector.wired()
    objects = {f"{name}_kernel_{target.name}.o": object_files.emit(wired, target, name)}
    for vector in vectors:
        objects[f"{name}_block_{vector}_{target.name}.o"] = object_files.emit_block(wired, target, vector, name)
    for file, content in objects.items():
        (place / file).write_bytes(content)
    return [place / file for file in objects]


def block_texts() -> dict[str, str]:
    """Header and source of blocks of injectors."""
    return {"block.h": template("block.h").replace("/*LANES*/", str(LANES)), "block.c": template("block.c")}


def write_around(model: Model, folder: Path, texts: Mapping[str, str]) -> list[Path]:
    """Write texts as files, with the model's name inserted in the texts and in front of the file names."""
    return write_texts(
        folder, {f"{model.name}_{name}": insert_model_name(text, model.name) for name, text in texts.items()}
    )


def _write_binaries(model: Model, folder: Path, place: Path, target: Target, compiler: Compiler) -> list[Path]:
    """Compile a target into `place`: objects, static library and, last, the shared one.

    `folder` has the sources.
    """
    upper, vectors = model.name.upper(), list_vectors(target)
    kernels = write_kernels(model, place, target, vectors)
    defines = (f"{upper}_VECTORS",) if vectors else ()
    sources = [path for path in sorted(folder.glob("*.c")) if path.stem != f"{model.name}_kernel"]
    objects = [place / f"{source.stem}.o" for source in sources]
    for source, compiled in zip(sources, objects, strict=True):
        object_files.compile_source(compiler, source, compiled, target, defines)
    prefix = "" if target.suffix == ".dll" else "lib"
    static, shared = place / f"lib{model.name}.a", place / f"{prefix}{model.name}{target.suffix}"
    object_files.archive(compiler, (*objects, *kernels), static)
    for compiled in objects:
        compiled.unlink()
    object_files.link_shared(compiler, (*sources, *kernels), shared, target, (f"{upper}_SHARED", *defines))
    return [*kernels, static, shared]


def write_sources(model: Model, folder: Path) -> list[Path]:
    """Write header and sources of a model."""
    return write_texts(folder, {f"{model.name}.h": model.header, **model.sources})


def write_texts(folder: Path, texts: Mapping[str, str]) -> list[Path]:
    """Write texts as files of these names; return the files."""
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    return [folder / name for name in texts]


def _write_examples(model: Model, folder: Path, beside: str) -> list[Path]:
    """Write programs that use the library.

    `beside` is the path from `folder` to the binaries, for command lines; "" if they are in the folder itself.
    """
    size = sizes(model.injector.wired())
    replacements = {
        "FOLDER/": beside,
        "libcr.a": f"lib{model.name}.a",
        " cr.c ": f" {model.name}.c ",
        "PARAMETERS, CHANNELS = 0, 0": f"PARAMETERS, CHANNELS = {size.parameters + 1}, {size.channels}",
    }
    texts = {}
    for source, name in {**_EXAMPLES, "sfunction.c": f"{model.name}_sfunction.c"}.items():
        texts[name] = insert_model_name(template(source), model.name)
        for before, after in replacements.items():
            texts[name] = texts[name].replace(before, after)
    return write_texts(folder, texts)
