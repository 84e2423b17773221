"""Libraries of lane loops for a package or a clone: ``python -m commonrail.export.lane_library [FOLDER] [WIRINGS]``.

Each level of x86-64 gets one library, of the same objects that the cache of kernels holds. `engine.library` uses them.
"""

from __future__ import annotations

import itertools
import json
import os
import shutil
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from commonrail.choices import Actuation, Body, Boundary, Drive, Laws, Precision
from commonrail.compile_target import LEVEL_3, LEVEL_4, Processor, lane_settings, package_version
from commonrail.engine.lanes import VECTORS
from commonrail.engine.library import COMPILERS, FOLDER, STAMP, digest, file_of
from commonrail.engine.machine_code import object_of, symbol_of
from commonrail.errors import ConfigurationError
from commonrail.export.linker import compiler_for, link_shared
from commonrail.export.objects import target_named
from commonrail.injector.variants import Variant
from commonrail.kernel_cache import sources_stamp

__all__ = ["ALL", "CATALOGUE", "write_libraries"]

_SERVO = tuple(
    Variant(body, boundary, drive, laws) for laws in Laws for body in Body for boundary in Boundary for drive in Drive
)
_DIRECT = tuple(Variant(drive=drive, laws=laws, actuation=Actuation.DIRECT) for laws in Laws for drive in Drive)
ALL = (*_SERVO, *_DIRECT)
# The injectors of the catalogue with either body, and with the drive that replaces theirs in searches.
CATALOGUE = (
    *(v for v in _SERVO if v.laws is Laws.PAPER and v.drive in (Drive.PWM, Drive.REGULATED)),
    Variant(drive=Drive.CURRENT, actuation=Actuation.DIRECT),
)


def write_libraries(
    folder: Path,
    variants: Sequence[Variant] = CATALOGUE,
    precisions: Sequence[Precision] = tuple(Precision),
    levels: Sequence[Processor] = (LEVEL_3, LEVEL_4),
) -> tuple[Path, ...]:
    """Compile and link loops; returns the libraries.

    Parameters
    ----------
    folder : Path
        Made where it is missing; libraries of the same names are replaced.
    variants, precisions, levels : sequences
        A loop is compiled for each of each, some ten seconds where it is in no cache; in double precision an exact one
        too.

    Raises
    ------
    ConfigurationError
        If there is no C compiler, or it fails.
    """
    target = target_named("linux64")
    compiler = compiler_for(target)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / STAMP).unlink(missing_ok=True)  # without it no library is used, also if this ends halfway
    made = []
    for level in levels:
        with tempfile.TemporaryDirectory() as name:
            place = Path(name)
            shutil.copy(Path(__file__).with_name("c") / "level.c", place)
            inputs = [place / "level.c"]
            for variant in variants:
                for precision, exact in itertools.product(precisions, (False, True)):
                    if exact and precision is Precision.F32:
                        continue  # it screens candidates of some searches: compiled where that is asked for
                    inputs.append(place / f"{symbol_of(variant, precision, exact)}.o")
                    inputs[-1].write_bytes(object_of(variant, VECTORS[precision], level._replace(exact=exact))[0])
            library = place / file_of(level.name).name
            link_shared(compiler, inputs, library, target, ())
            made.append(folder / library.name)
            # replaced whole: a process may be running the one before
            os.replace(shutil.copy(library, folder / f".{library.name}"), made[-1])
    stamp = {
        "sources": sources_stamp(),
        "settings": lane_settings(),
        "libraries": {path.name: digest(path) for path in made},
        **{package: package_version(package) for package in COMPILERS},
    }
    (folder / STAMP).write_text(json.dumps(stamp, indent=1) + "\n", encoding="utf-8")
    return tuple(made)


def _main(words: list[str]) -> int:
    folder = Path(words[0]) if words else FOLDER
    try:
        made = write_libraries(folder, ALL if words[1:] == ["all"] else CATALOGUE)
    except ConfigurationError as error:
        print(f"commonrail: {error}", file=sys.stderr)
        return error.exit_code
    for path in made:
        print(f"{path}: {path.stat().st_size / 1e6:.2f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(_main(sys.argv[1:]))
