"""Parts and catalogue files of the package and of installed plug-ins, by group and name, loaded when first asked for.

A package registers a part by an entry point, for example a verb in its ``pyproject.toml``::

    [project.entry-points."commonrail.verbs"]
    histogram = "my_package.verb:histogram"

Parts that ship with commonrail are registered in the table of `commonrail.plugins`, which spares a search of the disk.
Of several parts of one name the shipped one is used, else the part of the first package in alphabetical order;
`find_unused` has a sentence on each of the others.
"""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache
from importlib import import_module, resources
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple, TypeVar

from commonrail.base.errors import CommonrailError, InputError, PluginError, nearest
from commonrail.base.hooks import note_of_process

_Kind = TypeVar("_Kind")
# File of a plug-in folder that has a part, the part's name and the attribute that it is.
_IN_FOLDERS = {"verbs": ("verb.py", "{}", "{}"), "results": ("page.py", "{}.json", "RESULT")}
PACKAGE = "commonrail"
GROUPS = (
    "verbs",
    "data",
    "views",
    "optimisers",
    "readers",
    "injectors",
    "fuels",
    "meters",
    "features",
    "nozzle_laws",
    "a_hole_laws",
    "results",
    "studies",
    "study_keys",
    "after_fit",
    "pages",
    "openings",
    "live",
    "inspectors",
    "simulations",
)


def load(target: str) -> Any:
    """Import and return the object ``module:object``."""
    module, _, attribute = target.partition(":")
    return getattr(import_module(module), attribute)


class Entry(NamedTuple):
    """Registered part.

    Attributes
    ----------
    group : str
        One of `GROUPS`.
    name : str
        Of the verb, method, kind of data, injector, fuel, meter, feature or law; of "readers" and "inspectors" the
        ending of a file without its point; of "results" the record file by which a folder tells its kind, such as
        "comparison.json"; of "studies" NAME where the file has the format "commonrail-NAME/1" and a run folder keeps it
        as "NAME.toml"; of "study_keys" the key of a study file that names a file of the part; of "pages" the file in a
        run folder that `report --page` writes; of "openings" the file in a run folder whose sentences open its
        report; of "simulations" "page" and "figure", what a single simulation is shown
        with, "heating", what is estimated beside it, and ".dat" for a file of `simulate --out` that ends so; of
        "after_fit" and "live" any, and they are called in alphabetical order of it after those that ship.
    target : str
        ``module:object``.
    distribution : str
        Name of the installed package that registers it.
    version : str
        Of that package; empty for what ships.
    """

    group: str
    name: str
    target: str
    distribution: str = PACKAGE
    version: str = ""

    def load_as(self, kind: type[_Kind], what: str) -> _Kind:
        """Import and return the object, which is to be of a kind; `what` names that kind in words.

        Raises `PluginError` as `load`; also if it is of another kind.
        """
        loaded = self.load()
        if not isinstance(loaded, kind):
            raise self.part_error(f"is to be {what}, and {self.target} is none")
        return loaded

    def part_error(self, reason: str) -> PluginError:
        """Error that names the part, with the predicate `reason`."""
        return PluginError(
            f'plug-in {self.distribution} {self.version}: "{self.name}" of {PACKAGE}.{self.group} {reason}; update or '
            f"uninstall {self.distribution}.",
            code="broken-part",
        )

    @contextmanager
    def blame(self, predicate: str) -> Iterator[None]:
        """Name the part in what the code of an installed package raises inside, with a `predicate` as "fails on FILE".

        Errors of the project pass, and those of what ships.

        Raises `PluginError` in place of any other exception.
        """
        try:
            yield
        except CommonrailError:
            raise
        except Exception as error:
            if self.distribution == PACKAGE:
                raise
            raise self.part_error(f"{predicate} ({type(error).__name__}: {error})") from error

    def load(self) -> Any:
        """Import and return the object.

        Raises `PluginError` if the import of an installed plug-in fails, whatever its reason.
        """
        with self.blame(f"cannot be loaded from {self.target}"):
            try:
                return load(self.target)
            except SystemExit as error:  # a package that leaves by sys.exit takes no other one with it
                raise ImportError(f"sys.exit({error})") from error

    def citation(self) -> str:
        """`__citation__` of the package's top-level module, by default its summary; empty if it cannot be read."""
        from importlib import metadata  # slow to import

        with suppress(Exception):  # parts of a broken package report it
            return str(load(f"{self.target.partition(':')[0].partition('.')[0]}:__citation__"))
        with suppress(metadata.PackageNotFoundError, KeyError):
            return str(metadata.metadata(self.distribution)["Summary"] or "")
        return ""

    def call(self, *args: Any) -> Any:
        """Load the function and call it; `PluginError` for what one of an installed plug-in raises."""
        function = self.load()
        with self.blame("fails"):
            return function(*args)


@cache
def find_shipped(group: str) -> Mapping[str, Entry]:
    """Parts that ship with the package, by name in the order of its table, then those of folders that it lacks."""
    plugins = import_module(f"{PACKAGE}.plugins")
    targets: dict[str, str] = {**plugins.SHIPPED.get(group, {}), **_of_folders(group, plugins)}
    return {name: Entry(group, name, target) for name, target in targets.items()}


def words_on_shipped(table: str) -> Mapping[str, Any]:
    """Table of `commonrail.plugins` with words on what ships: "HEADINGS" of the help, "MEMORY" with cures."""
    words: Mapping[str, Any] = getattr(import_module(f"{PACKAGE}.plugins"), table)
    return words


def _of_folders(group: str, plugins: ModuleType) -> dict[str, str]:
    """Verbs and results of plug-in folders that no entry of the table names.

    The verb NAME is the function ``name`` of ``name/verb.py``, the result NAME.json ``RESULT`` of ``name/page.py``.
    """
    if group not in _IN_FOLDERS:
        return {}
    file, form, attribute = _IN_FOLDERS[group]
    targets = [target.split(".") for table in plugins.SHIPPED.values() for target in table.values()]
    listed = {folder for _, package, folder, *_ in targets if package == "plugins"}
    root = plugins.__path__[0]
    others = [
        name for name in sorted(os.listdir(root)) if name not in listed and os.path.isfile(f"{root}/{name}/{file}")
    ]
    return {
        form.format(folder.replace("_", "-")): f"{plugins.__name__}.{folder}.{file[:-3]}:{attribute.format(folder)}"
        for folder in others
    }


@cache
def find_installed(group: str) -> Mapping[str, Entry]:
    """Parts that other installed packages register, by name in alphabetical order; a warning names those unused."""
    displaced = find_unused(group)
    for sentence in displaced.values():
        note_of_process(sentence)
    return {name: entries[0] for name, entries in _find_registered(group).items() if entries[0] not in displaced}


def find_unused(group: str) -> Mapping[Entry, str]:
    """Parts of installed packages that another one of the same name displaces, with a sentence on each."""
    sentences = {}
    registered = _find_registered(group)
    ships = _find_shipped_names(group) if registered else ()
    for name, entries in registered.items():
        used = PACKAGE if name in ships else entries[0].distribution
        for entry in entries[used != PACKAGE :]:
            sentences[entry] = str(entry.part_error(f"is not used, because {used} has a part of the same name"))
    return sentences


def _find_shipped_names(group: str) -> Collection[str]:
    """Names of the parts that ship, also of a group that has them in a list of the core."""
    elsewhere: Mapping[str, str] = import_module(f"{PACKAGE}.plugins").ELSEWHERE
    listing = load(elsewhere[group]) if group in elsewhere else find_shipped(group)
    names: Collection[str] = listing() if callable(listing) else listing
    return names


def _find_registered(group: str) -> Mapping[str, list[Entry]]:
    """All parts of installed packages by name, both in alphabetical order."""
    from importlib.metadata import entry_points  # slow to import

    registered: dict[str, list[Entry]] = {}
    points = [(point, point.dist) for point in entry_points(group=f"{PACKAGE}.{group}") if point.dist is not None]
    for point, package in sorted(points, key=lambda pair: (pair[0].name, pair[1].name)):
        entry = Entry(group, point.name, point.value, package.name, package.version)
        registered.setdefault(point.name, []).append(entry)
    return registered


def entries(group: str) -> Mapping[str, Entry]:
    """All parts of a group by name, shipped parts first."""
    return {**find_shipped(group), **find_installed(group)}


def find(group: str, name: str) -> Entry | None:
    """Part of a name, or None; installed packages are searched only where none of that name ships."""
    return find_shipped(group).get(name) or find_installed(group).get(name)


def require(group: str, name: str) -> Entry:
    """Part of a name; `InputError` if the distribution lacks it."""
    if (entry := find(group, name)) is None:
        raise InputError(
            f'The part "{name}" of {PACKAGE}.{group} is missing; install the package that has it.',
            code="missing-package",
        )
    return entry


# TOML files by name: fuels, injectors and truths of the virtual test bench.
#
# Some ship with the package. Those of an installed package are entry points of the groups "fuels", "injectors" and
# "meters", whose object is the path of a file, or a function that returns it.


class Catalogue(NamedTuple):
    """Folder of TOML files in a package."""

    package: str
    folder: str
    unknown: str  # beginning of the message for an unknown name, such as ``There is no fuel "{}"``
    cure: str = ", or give the path of a .toml file"  # end of that message
    group: str = ""  # of the files of installed packages, or empty

    def names(self) -> list[str]:
        """All names: shipped files, then files of installed packages."""
        shipped = self.shipped()
        return shipped + [name for name in find_installed(self.group) if name not in shipped]

    def __contains__(self, name: object) -> bool:
        return name in self.shipped() or name in find_installed(self.group)

    def shipped(self) -> list[str]:
        """Names of the files that ship without ``.toml``, sorted."""
        files = (entry.name for entry in (resources.files(self.package) / self.folder).iterdir())
        return sorted(name.removesuffix(".toml") for name in files if name.endswith(".toml"))

    def text(self, name: str, hint: str = "") -> str:
        """Text of a file; an unknown name raises `InputError` with `hint`, by default the nearest name."""
        if name in self.shipped():
            return (resources.files(self.package) / self.folder / f"{name}.toml").read_text(encoding="utf-8")
        if contents := read_installed(self.group, name):
            return contents
        choice = f"choose one of {', '.join(self.names())}{self.cure}."
        raise InputError(f"{self.unknown.format(name)}{hint or self.meant(name)}: {choice}", code="unknown-name")

    def parts(self) -> dict[str, str]:
        """Names of the files by the part numbers, of ten digits, that they state."""
        return {number: name for name in self.names() for number in re.findall(r"\b\d{10}\b", self.text(name))}

    def meant(self, name: str) -> str:
        """The nearest name, or of a part number, as 0 445 110 191, the names of the files that state it."""
        number = part_digits(name)
        if number and (files := dict.fromkeys(file for digits, file in self.parts().items() if number in digits)):
            return f" (did you mean {' or '.join(files)}, whose file names this part?)"
        return nearest(name, self.names())


def part_digits(text: str) -> str:
    """Digits of a part number: at least four, or six next to words; empty if fewer, as in iso4113."""
    digits = re.sub(r"\D", "", text, flags=re.ASCII)
    if len(digits) == 9 and digits.startswith("445"):
        digits = f"0{digits}"  # which spreadsheets drop
    return digits if (6 if any(map(str.isalpha, text)) else 4) <= len(digits) <= 10 else ""


def read_installed(group: str, name: str) -> str | None:
    """Text of a file of an installed package; None for an unknown name.

    Raises `PluginError` if it cannot be read.
    """
    if (entry := find(group, name)) is None:
        return None
    target = entry.load()
    with entry.blame("gives no file that can be read"):
        path = target() if callable(target) else target
        return str((Path(path) if isinstance(path, str) else path).read_text(encoding="utf-8"))
