"""FMU of a model: a ZIP with description, one binary per platform, sources, and documentation."""

from __future__ import annotations

import tempfile
import uuid
import zipfile
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

from commonrail.base.errors import ConfigurationError
from commonrail.base.hooks import ALL_ENTRIES, lasting
from commonrail.base.output import replacing
from commonrail.engine.time_step import DEFAULT_STEP
from commonrail.physics.injector import Injector
from commonrail.physics.variants import DRIVE, unread_inputs
from commonrail.physics.variants import RAIL as RAIL_INPUT
from commonrail.physics.variants import RETURN as BACK
from commonrail.plugins.export import description
from commonrail.plugins.export.description import CYLINDER, RAIL, RETURN, Variable
from commonrail.plugins.export.library import block_texts, write_around, write_kernels, write_sources, write_texts
from commonrail.plugins.export.object_files import Compiler, Target, compiler_for, link_shared, list_vectors
from commonrail.plugins.export.sources import Model, make_model, source_file, template
from commonrail.report.html import render


def documentation_page(model: Model, listed: Sequence[Variable]) -> str:
    """HTML text of the page inside an FMU: purpose, variables, limits."""
    injector = model.injector
    return render(
        "model.html",
        package=__package__,
        title=injector.name,
        injector=injector,
        pressures=[1e-6 * pressure for pressure in injector.fuel.pressure_range],
        variables=listed,
        version=version("commonrail"),
    )


_HEADERS = {
    2: ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"),
    3: ("fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h"),
}
_DESCRIPTIONS = {2: description.describe2, 3: description.describe3}
# Date of the files in the ZIP: equal FMUs have equal bytes except for the date in the description.
_WHEN = (1980, 1, 1, 0, 0, 0)


class Instance(NamedTuple):
    """Variables of an FMU, and the C sources that connect them with the library.

    `texts`: by name, with ``cr`` in place of the model's name; the line ``/*START*/`` of ``fmu.h`` receives the
    token. `page`: HTML of the documentation. `blocks`: with blocks of injectors.
    """

    model: Model
    variables: Sequence[Variable]
    texts: Mapping[str, str]
    page: str
    blocks: bool = False


@lasting(ALL_ENTRIES)
def write_fmu(
    injector: Injector, out: Path, targets: Sequence[Target], fmi: int = 2, flat: bool = False
) -> tuple[str, ...]:
    """Write an injector as an FMU for co-simulation; return the names of its files.

    Its values are the start values, its names `flat` or not as in `variables`. Binaries are made for the target
    platforms, `fmi` is the version of the standard, 2 or 3. `ConfigurationError` if the standard has no such platform,
    or a compiler is missing or fails.
    """
    find_tools(targets, fmi)
    model, listed = make_model(injector), description.variables(injector, flat)
    fmu = Instance(model, listed, _injector_texts(injector), documentation_page(model, listed))
    return write_instance(fmu, out, targets, fmi)


def write_instance(fmu: Instance, out: Path, targets: Sequence[Target], fmi: int) -> tuple[str, ...]:
    """Write the FMU of an instance; errors as in `write_fmu`."""
    folders, compilers = find_tools(targets, fmi)
    model, listed = fmu.model, fmu.variables
    token = f"{{{uuid.UUID(model.stamp[:32])}}}"
    with tempfile.TemporaryDirectory(prefix="commonrail-") as temporary:
        folder = Path(temporary)
        written = [*write_sources(model, folder), *_write_instance(fmu, folder, token, fmi)]
        to_compile = [path.name for path in written if path.suffix == ".c"]
        describe = _DESCRIPTIONS[fmi]
        contents = {"modelDescription.xml": describe(model, listed, token, to_compile).encode()}
        for target in targets:
            binary = folder / f"{target.name}{target.suffix}"
            _link(compilers[target.name], fmu, folder, binary, target)
            contents[f"binaries/{folders[target.name]}/{model.name}{target.suffix}"] = binary.read_bytes()
        contents |= {f"sources/{path.name}": path.read_bytes() for path in written}
    contents["model.png" if fmi == 2 else "terminalsAndIcons/icon.png"] = source_file("icon.png").read_bytes()
    if fmi == 3:
        contents["sources/buildDescription.xml"] = description.build_description(model, to_compile).encode()
        contents["terminalsAndIcons/terminalsAndIcons.xml"] = description.terminals(listed).encode()
    contents["documentation/index.html"] = fmu.page.encode()
    contents["documentation/licenses/notices.txt"] = template("notices.txt").replace("NAME", model.name).encode()
    _pack(out, contents)
    return tuple(contents)


def _link(compiler: Compiler, fmu: Instance, folder: Path, binary: Path, target: Target) -> None:
    """Link the binary of a target: the surrounding C, and the physics as compiled by LLVM."""
    model, vectors = fmu.model, list_vectors(target) if fmu.blocks else ()
    kernels = write_kernels(model, folder, target, vectors)
    around = sorted(path for path in folder.glob("*.c") if path.stem != f"{model.name}_kernel")
    defines = (f"{model.name.upper()}_VECTORS",) if vectors else ()
    link_shared(compiler, (*around, *kernels), binary, target, defines)


def find_tools(targets: Sequence[Target], fmi: int) -> tuple[dict[str, str], dict[str, Compiler]]:
    """Folder of the binary and compiler of each target by name; errors as in `write_fmu`."""
    check_fmi(fmi)
    folders = {target.name: target.fmi2 if fmi == 2 else target.fmi3 for target in targets}
    for target in targets:
        if not folders[target.name]:
            raise ConfigurationError(
                f"FMI {fmi}.0 has no folder for binaries of {target.name}; leave this platform out"
                + (", or write an FMU of version 3." if fmi == 2 and target.fmi3 else ".")
            )
    return folders, {target.name: compiler_for(target, prefer_zig=True) for target in targets}


def check_fmi(version: int) -> None:
    """Raise `ConfigurationError` for an unsupported version of the standard."""
    if version not in _HEADERS:
        versions = " and ".join(map(str, _HEADERS))
        raise ConfigurationError(f"FMUs are written for version {versions} of the FMI standard, not {version}.")


def _injector_texts(injector: Injector) -> dict[str, str]:
    """Sources that depend on the variables of an injector's FMU."""
    start = {"STEP": DEFAULT_STEP, "RAIL": RAIL, "CYLINDER": CYLINDER, "RETURN": RETURN}
    defines = [f"#define CR_FMU_{name} {value!r}" for name, value in start.items()]
    unread = unread_inputs(injector.variant)
    defines += [f"#define CR_FMU_READS_{name.upper()} {int(name not in unread)}" for name in (RAIL_INPUT, BACK, DRIVE)]
    return {
        "fmu.h": template("fmu.h").replace("/*START*/\n", "/*START*/\n" + "\n".join(defines) + "\n"),
        "fmu.c": template("fmu.c"),
    }


def _write_instance(fmu: Instance, folder: Path, token: str, fmi: int) -> list[Path]:
    """Write the sources around the library that make it an FMU."""
    texts = {name: text.replace("/*START*/", f'#define CR_GUID "{token}"') for name, text in fmu.texts.items()}
    common = {name: template(name) for name in ("instance.h", "instance.c", f"fmi{fmi}.c")}
    blocks = block_texts() if fmu.blocks else {}
    written = write_around(fmu.model, folder, {**texts, **common, **blocks})
    return written + write_texts(folder, {name: template(f"fmi/{name}") for name in _HEADERS[fmi]})


def _pack(out: Path, contents: dict[str, bytes]) -> None:
    """Write the ZIP; an existing file is replaced once the new one is complete."""
    with replacing(out, "wb") as stream, zipfile.ZipFile(stream, "w", compresslevel=9) as archive:
        for path, content in contents.items():
            entry = zipfile.ZipInfo(path, _WHEN)
            entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
            archive.writestr(entry, content)
