"""Foreign FMU: its description, and its files unpacked for the processes that simulate it."""

from __future__ import annotations

import io
import math
import tempfile
import zipfile
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from commonrail.arguments import file_path
from commonrail.errors import InputError, nearest
from commonrail.reading.guarded_file import read_plain, sha256
from commonrail.units import compatible

__all__ = ["INSTALL", "REAL", "Fmu", "FmuVariable", "read_fmu", "unpacked"]

INSTALL = "FMUs are read with FMPy; install it with: pip install 'commonrail[fmi]'"
REAL = ("Real", "Float64", "Float32")  # types of numbers that can be calibrated and compared
LARGEST_CONTENT = 2_000_000_000  # [bytes] of an FMU when it is unpacked
LARGEST_DESCRIPTION = 200_000_000  # [bytes] of its description, which is held as a tree some ten times as large
DESCRIPTION = "modelDescription.xml"


class FmuVariable(NamedTuple):
    """A scalar variable.

    Attributes
    ----------
    name, causality, variability, type, description : str
        In the words of the standard.
    unit : str
        As the FMU writes it; "1" where it has none.
    start : str or None
        Start value as the FMU writes it.
    settable : bool
        Whether a value can be set before the initialization.
    lower, upper : float
        Smallest and largest value that the FMU allows; infinite where it states none.
    """

    name: str
    causality: str
    variability: str
    type: str
    unit: str
    start: str | None
    settable: bool
    description: str
    lower: float = -math.inf
    upper: float = math.inf

    @property
    def known_unit(self) -> str:
        """The unit if this program can convert it, else "1": numbers are then taken as they stand."""
        try:
            return self.unit if compatible(self.unit, self.unit) else "1"
        except InputError:
            return "1"


@dataclass(frozen=True)
class Fmu:
    """An FMU for co-simulation, version 2.0 or 3.0 of the standard.

    Attributes
    ----------
    path : Path
    digest : str
        SHA-256 of the file.
    name, version : str
        Of the model; version of the standard.
    variables : mapping of str to FmuVariable
    content : bytes
        The file.
    """

    path: Path
    digest: str
    name: str
    version: str
    variables: Mapping[str, FmuVariable]
    content: bytes = field(repr=False)

    def variable(self, name: str) -> FmuVariable:
        """Variable of a name.

        Raises
        ------
        InputError
            If there is none; the sentence names the nearest.
        """
        if name not in self.variables:
            raise InputError(f'{self.path}: the FMU has no variable "{name}"{nearest(name, self.variables)}.')
        return self.variables[name]

    def number(self, name: str) -> FmuVariable:
        """Variable that is a real number; `InputError` for another."""
        found = self.variable(name)
        if found.type not in REAL:
            raise InputError(f"{self.path}: {name} is of type {found.type}, and a real number is expected.")
        return found

    def outside(self, name: str, value: float, what: str) -> str:
        """Sentence on a value that lies outside the limits that the FMU states; empty where it does not.

        Parameters
        ----------
        name : str
            Of the variable.
        value : float
            In the unit of the FMU.
        what : str
            Words for the value.
        """
        found = self.variable(name)
        if found.lower <= value <= found.upper:
            return ""
        beyond, limit = ("below the min", found.lower) if value < found.lower else ("above the max", found.upper)
        return (
            f"{what} of {name}, {_in_unit(value, found)}, lies {beyond} that the FMU states, {_in_unit(limit, found)}"
        )

    def adjustable(self, name: str) -> FmuVariable:
        """Variable whose value can be set before the initialization; `InputError` for another."""
        found = self.variable(name)
        if not found.settable:
            raise InputError(
                f"{self.path}: {name} cannot be set (causality {found.causality}, variability {found.variability}); "
                "name a parameter or an input."
            )
        return found


def read_fmu(path: str | Path) -> Fmu:
    """Read the description of an FMU; none of its binaries is loaded.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    InputError
        If it is no FMU of version 2.0 or 3.0, none for co-simulation, has no binary for this machine or two
        variables of one name, or FMPy is not installed.
    """
    file = file_path(path, "path of an FMU")
    content = read_plain(file)
    fmpy = fmpy_or_error()
    try:
        names = _names(content)  # first: what is too large is not unpacked to be read
        description = fmpy.read_model_description(io.BytesIO(content), validate=False)
    except Exception as error:  # FMPy and lxml raise of their own what they cannot read
        raise InputError(f"{file}: this is no FMU that can be read ({_short(error)}).") from error
    if not description.fmiVersion.startswith(("2.", "3.")):
        raise InputError(f"{file}: the FMU is of version {description.fmiVersion}, and 2.0 or 3.0 is expected.")
    if description.coSimulation is None:
        raise InputError(f"{file}: the FMU is not for co-simulation; export it for co-simulation.")
    _check_binary(file, names, description.coSimulation.modelIdentifier, fmpy)
    named = Counter(one.name for one in description.modelVariables)
    if len(named) < len(description.modelVariables):
        raise InputError(
            f"{file}: {named.most_common(1)[0][0]} is the name of more than one variable, which the standard forbids; "
            "export the FMU anew with names that differ."
        )
    variables = {one.name: _variable(one) for one in description.modelVariables if not one.dimensions}
    return Fmu(file, sha256(content), description.modelName, description.fmiVersion, variables, content)


def fmpy_or_error() -> Any:
    """FMPy; `InputError` where it is not installed."""
    try:
        import fmpy
    except ImportError as error:
        raise InputError(f"{INSTALL}.") from error
    return fmpy


def _names(content: bytes) -> list[str]:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        size = sum(entry.file_size for entry in archive.infolist())
        if size > LARGEST_CONTENT:
            raise ValueError(f"unpacked it has {size / 1e6:.0f} MB, more than {LARGEST_CONTENT / 1e6:g} MB")
        described = archive.getinfo(DESCRIPTION).file_size
        if described > LARGEST_DESCRIPTION:
            limit = LARGEST_DESCRIPTION / 1e6
            raise ValueError(f"unpacked its {DESCRIPTION} has {described / 1e6:.0f} MB, more than {limit:g} MB")
        return archive.namelist()


def _check_binary(file: Path, names: list[str], model: str, fmpy: Any) -> None:
    wanted = [
        f"binaries/{folder}/{model}{fmpy.sharedLibraryExtension}" for folder in (fmpy.platform, fmpy.platform_tuple)
    ]
    if not any(name in names for name in wanted):
        held = sorted({name.split("/")[1] for name in names if name.startswith("binaries/") and name.count("/") > 1})
        raise InputError(
            f"{file}: the FMU has no binary {model}{fmpy.sharedLibraryExtension} for this machine ({fmpy.platform}), "
            f"only folders for {', '.join(held) or 'none'}; "
            "export it for this platform too, or compile its sources with `fmpy compile`."
        )


def _variable(one: Any) -> FmuVariable:
    unit = one.unit or (one.declaredType.unit if one.declaredType is not None else None)
    settable = one.causality == "input" or (one.variability != "constant" and one.initial in ("exact", "approx"))
    start = None if one.start is None else str(one.start)
    words = one.name, one.causality, one.variability, one.type, unit or "1", start
    return FmuVariable(
        *words, settable, one.description or "", _limit(one, "min", -math.inf), _limit(one, "max", math.inf)
    )


def _limit(one: Any, which: str, otherwise: float) -> float:
    """Limit of a variable, by its own statement or that of its type."""
    stated = getattr(one, which, None)
    if stated is None and one.declaredType is not None:
        stated = getattr(one.declaredType, which, None)
    try:
        return otherwise if stated is None else float(stated)
    except ValueError:
        return otherwise


def _in_unit(value: float, variable: FmuVariable) -> str:
    return f"{value:g}" if variable.unit == "1" else f"{value:g} {variable.unit}"


def _short(error: BaseException) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__


@contextmanager
def unpacked(fmu: Fmu) -> Iterator[Path]:
    """Folder with the files of an FMU, removed at the end.

    Raises
    ------
    InputError
        If the archive cannot be unpacked.
    """
    with tempfile.TemporaryDirectory(prefix="commonrail-fmu-", ignore_cleanup_errors=True) as temporary:
        folder = Path(temporary)
        try:
            fmpy_or_error().extract(io.BytesIO(fmu.content), unzipdir=folder)
        except InputError:
            raise
        except Exception as error:  # of zipfile and FMPy
            raise InputError(f"{fmu.path}: the FMU cannot be unpacked ({_short(error)}).") from error
        yield folder
