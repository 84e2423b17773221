"""Export of a model as a C library or as an FMU."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Literal

from commonrail.base.arguments import file_path, instance
from commonrail.base.errors import ConfigurationError
from commonrail.physics.injector import Injector
from commonrail.plugins.export.fmu import check_fmi, write_fmu
from commonrail.plugins.export.library import write_library
from commonrail.plugins.export.object_files import TARGETS, Target, find_target, own_platform


def export(
    injector: Injector,
    out: str | Path,
    form: Literal["library", "fmu"] = "library",
    *,
    platforms: Iterable[str] | None = None,
    fmi: int = 2,
    flat: bool = False,
) -> tuple[str, ...]:
    """Write a model as a C library or an FMU, which runs without Python and accepts every parameter at run time.

    Parameters
    ----------
    injector : Injector
        Its values are the start values.
    out : str or path
        Folder of the library, or file of the FMU.
    form : "library" or "fmu"
    platforms : list of str, optional
        Such as ``["linux64", "win64"]``; default: this machine's. Others need zig.
    fmi : int
        Version of the FMI standard, 2 or 3.
    flat : bool
        Flat names of an FMU's variables, for importers that interpret dots as buses.

    Returns
    -------
    tuple of str
        Written files; of an FMU those inside it.

    Raises
    ------
    ConfigurationError
        If a platform, form or version is unknown, or a compiler is missing.
    """
    path, targets = file_path(out, "out"), find_targets(platforms)
    instance(injector, Injector, "injector")
    if form == "library":
        return tuple(map(str, write_library(injector, path, targets).files))
    if form != "fmu":
        raise ConfigurationError(f'The form of an export must be "library" or "fmu", not {form!r}.')
    check_fmi(fmi)
    return tuple(f"{path}/{name}" for name in write_fmu(injector, path, targets, fmi, flat))


def find_targets(platforms: Iterable[str] | None) -> list[Target]:
    """Platforms by name, each once; default: this machine's most basic. `ConfigurationError` if there is none."""
    names = own_platform()[:1] if platforms is None else platforms
    targets = [find_target(name) for name in dict.fromkeys(name.strip() for name in names if name.strip())]
    if not targets:
        raise ConfigurationError(f"Platforms: no name was given; choose from {', '.join(TARGETS)}.")
    return targets
