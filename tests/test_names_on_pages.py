"""Names on the pages: every module, function, key, option, target and status in backticks exists, and every link.

A token in backticks is taken apart into names. Each must be the package's own: a file, a definition of the source (in
the class or module that the token names before it), a text that the source holds whole (a key, a word of a file
format), a parameter, an option, a target of make. What is not the package's own is listed here.
"""

from __future__ import annotations

import ast
import builtins
import functools
import itertools
import re
import tomllib
from collections import defaultdict
from pathlib import Path
from types import ModuleType

import pytest

import commonrail as cr
from commonrail.cli.grammar import cli
from tests.every import check_every
from tests.test_pages import ROOT, VERBS
from tools.reference_pages import GENERATED

SRC = ROOT / "src" / "commonrail"
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]

# Programs, packages and their words, environment variables, notation of JSON and SQLite.
FOREIGN = """
    pip jq nohup pytest ruff mypy njit ptxas python venv pre-commit lint-imports sqlite3 backup null nan inf
    numba.extending numba.core.types cfunc carray cgutils jit
    math.pi math pi NUMBA_DISABLE_JIT NUMBA_CPU_NAME generic synchronous -m from import
    NPY_DISABLE_CPU_FEATURES OPENBLAS_CORETYPE COMMONRAIL_BUILD_KERNELS
    NORMAL -force-vector-width -wal -shm .venv .venv-lowest .venv/bin/commonrail .venv/bin/python
    .venv/bin/pytest
    .xlsx .mf4 .mdf .lvm .mat .pq .foam .dat foam tableFile excel mdf mat
"""
# Names that examples give to the user's own things, and placeholders.
OWN = """
    my-project study-1
    my.toml my-truth.toml my-case my-folder my-injector runs/first runs/a runs/<study>-<n> worn study DIR RUN
    IDEAL LABEL INJECTOR VARIANT VERB START DURATION N NAME FILE copy.sqlite measurements.parquet data/evi.csv
    data/rail.csv p_rail seeds dead_times.csv points.csv part.toml member-2.toml member-3.toml
    shots.mf4 FILE.fmu NAME_observer.h NAME_observer_size found.disturbance run.rate units.rate us_ rate.foam
    rate_lower rate_upper map.dcm
"""
TOKEN = re.compile(
    r"""
    (?P<option>(?<![\w-])--?[a-z][\w-]*)
    | (?P<path>[\w.*<>-]*/[\w.*<>/-]*|[\w-]+\.(?:py|md|toml|csv|json|html|sqlite|lock|parquet|txt)\b)
    | (?P<number>\d[\w.%]*)
    | (?P<word>[A-Za-z_]\w*(?:-\w+)+)
    | (?P<name>\.?[A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*)
    """,
    re.X,
)


def prose(page: Path) -> str:
    return re.sub(r"^ *```.*?^ *```", "", page.read_text(encoding="utf-8"), flags=re.S | re.M)


# --- What there is --------------------------------------------------------------------------------------------------


class Source:
    """Definitions and texts of Python files: members of each module and class by its bare name, and all texts."""

    def __init__(self, *roots: Path) -> None:
        self.members: dict[str, set[str]] = defaultdict(set)
        self.names: set[str] = set()
        self.texts: set[str] = set()
        self.of_file: dict[Path, set[str]] = {}
        self.bases: dict[str, list[str]] = defaultdict(list)
        for path in (path for root in roots for path in sorted(root.rglob("*.py"))):
            before, self.names = self.names, set()
            stem = path.parent.name if path.stem == "__init__" else path.stem
            self.members[path.parent.name].add(stem)
            self._read(ast.parse(path.read_text(encoding="utf-8")), [stem])
            self.of_file[path] = self.names
            self.names = before | self.names
        for path in (path for root in roots for path in root.rglob("*/")):
            self.members[path.parent.name].add(path.name)

    def has(self, owner: str, name: str) -> bool:
        """Return whether a module or class, or a base of the class, defines a name."""
        return name in self.members[owner] or any(self.has(base, name) for base in self.bases[owner])

    def _define(self, name: str, owner: str) -> None:
        self.members[owner].add(name)
        self.names.add(name)

    def _read(self, node: ast.AST, owners: list[str]) -> None:
        for child in ast.iter_child_nodes(node):
            inner = owners
            if isinstance(child, ast.ClassDef):
                self.bases[child.name] += [base.id for base in child.bases if isinstance(base, ast.Name)]
            match child:
                case ast.ClassDef(name=name) | ast.FunctionDef(name=name):
                    self._define(name, owners[-1])
                    inner = [*owners, name]
                case ast.Name(id=name, ctx=ast.Store()) | ast.arg(arg=name):
                    self._define(name, owners[-1])
                case ast.Attribute(attr=name, ctx=ast.Store()):
                    self._define(name, owners[-2] if len(owners) > 1 else owners[-1])
                case ast.alias(name=name, asname=asname):
                    self.members[owners[-1]].add(asname or name)
                case ast.Constant(value=str(text)):
                    self.texts.add(text)
            self._read(child, inner)


@functools.cache
def source() -> Source:
    return Source(SRC)


@functools.cache
def tools() -> Source:
    return Source(ROOT / "tools", ROOT / "studies", ROOT / "benchmarks", ROOT / "tests" / "robustness")


@functools.cache
def suite() -> Source:
    return Source(ROOT / "tests")


@functools.cache
def options() -> frozenset[str]:
    commands = [cli, *VERBS.values()]
    named = {option for command in commands for p in command.params for option in (*p.opts, *p.secondary_opts)}
    return frozenset(named | {"--help", "-h"} | {text for text in tools().texts if text.startswith("--")})


@functools.cache
def targets() -> frozenset[str]:
    return frozenset(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M))


@functools.cache
def words() -> frozenset[str]:
    """Names that stand alone: definitions, whole texts, verbs, catalogue, status codes, parameters."""
    parameters = {part for path in cr.models.parameter_quantities() for part in (path, *path.split("."))}
    files = {path.stem for path in SRC.rglob("*.toml")} | {path.name for path in (ROOT / "cases").iterdir()}
    rooms = {path.name for path in SRC.iterdir()} | {path.stem for path in SRC.iterdir()}
    known = source().names | source().texts | parameters | files | rooms | set(VERBS) | set(dir(builtins))
    return frozenset(known | {"True", "False", "None", "commonrail", "cr"})


def is_member(name: str) -> bool:
    """Return whether `a.b.c` leads from a module or class `a` to its `b`, and from that to `c`."""
    parts = name.removeprefix("commonrail.").removeprefix("cr.").split(".")
    if len(parts) == 1:
        return parts[0] in cr.__all__ or parts[0] in source().members["commonrail"]
    space = getattr(cr, parts[0]) if parts[0] in cr.__all__ else None
    if isinstance(space, ModuleType) and (name.startswith("cr.") or parts[1] in space.__all__):
        return parts[1] in space.__all__ and (len(parts) == 2 or is_member(".".join(parts[1:])))
    return any(all(each.has(*pair) for pair in itertools.pairwise(parts)) for each in (source(), tools(), suite()))


def is_file(name: str, page: Path) -> bool:
    pattern = re.sub(r"<\w+>", "*", name).rstrip("/")
    for root in (ROOT, SRC, ROOT / "docs", page.parent, ROOT / "tests"):
        if any(root.glob(pattern)) if "*" in pattern else (root / pattern).exists():
            return True
    last = pattern.rpartition("/")[2]
    if "/" not in name and any(path.name == name for path in (*source().of_file, *tools().of_file, *suite().of_file)):
        return True
    # what a run or a tool writes
    return any(last in each.texts or name in each.texts for each in (source(), tools())) or name in ignored()


@functools.cache
def ignored() -> frozenset[str]:
    return frozenset(line.strip("/") + "/" for line in (ROOT / ".gitignore").read_text(encoding="utf-8").split())


def is_known(kind: str, name: str, page: Path) -> bool:
    if name in (FOREIGN + OWN).split() or kind == "number" or len(name) == 1:
        return True
    if kind == "option":
        return name in options()
    if kind == "word":  # words of a variant, a verb, an entry of the catalogue
        return name in words() or name.replace("-", " ") in words()
    if kind == "path":
        return is_file(name, page)
    if kind == "name" and "." in name.strip("."):
        parts = name.split(".")
        # a name, a parameter, or a path in a TOML file: its tables and keys are texts or fields
        return is_member(name) or name in words() or (parts[0] in KEYS and all(part in words() for part in parts))
    name = name.strip(".")
    if name.startswith("_"):  # `*_damping`: names that end so
        return any(each.endswith(name) for each in words())
    return name in words() or name in tools().names | tools().texts | suite().names or name in markers()


@functools.cache
def markers() -> frozenset[str]:
    """Words that mark a test."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["pytest"]["ini_options"]
    return frozenset(text.partition(":")[0] for text in settings["markers"])


KEYS = {"data", "fuel", "meter", "meters", "values", "p"}  # what begins a path in a file, or a formula's parameters


def unknown(token: str, page: Path) -> list[str]:
    """Names in a token that do not exist."""
    if token.startswith("make "):
        return [word for word in token.split()[1:] if word not in targets()]
    if token.startswith(("commonrail ", "pip ")) or token in ("#", "@"):
        return []  # `test_pages` reads the command lines
    if re.search(r'": "', token):
        return []  # a message, quoted
    bare = re.sub(r'"([^"]*)"', lambda text: "" if " " in text[1] else text[1], token)  # several words: an example
    found = [(match.lastgroup or "", match.group()) for match in TOKEN.finditer(bare)]
    return [name for kind, name in found if not is_known(kind, name.removesuffix("."), page)]


# --- Tests ----------------------------------------------------------------------------------------------------------


def tokens(text: str) -> list[str]:
    return re.findall(r"(?<!`)`([^`\n]+)`(?!`)", text)


def test_every_name_on_a_page_exists() -> None:
    def check(page: Path) -> None:
        assert {token: names for token in tokens(prose(page)) if (names := unknown(token, page))} == {}

    check_every(PAGES, check)


def misplaced(text: str) -> list[str]:
    """Names that a page puts into a file which does not define them: "`x.py` (`a`, `b`)" and "(`x.py`, `a`)"."""
    several = r"`[\w.]+`(?:(?:,|,? and)\s+`[\w.]+`)*"
    found = re.findall(rf"`([\w/]+\.py)`\s+\(({several})\)|\(`([\w/]+\.py)`,\s+({several})\)", text)
    placed = [(one or two, tokens(names or more)) for one, names, two, more in found]
    return [
        f"{name} in {file}"
        for file, names in placed
        for name in names
        if not any(name in defined for path, defined in source().of_file.items() if path.match(f"*/{file}"))
    ]


def test_a_name_stands_in_the_file_that_a_page_gives_for_it() -> None:
    assert {page: names for page in PAGES if (names := misplaced(prose(page)))} == {}


def test_every_status_in_the_text_exists() -> None:
    statuses = {status.name for status in cr.Status}
    for page in PAGES:
        named = set(re.findall(r"\b[A-Z]{3,}(?:_[A-Z]{2,})+\b", re.sub(r"`[^`]*`", "", prose(page))))
        assert named - statuses == set(), page


def anchors(page: Path) -> set[str]:
    """Anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", prose(page), re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_every_link_leads_to_a_file_and_its_heading() -> None:
    check_every(PAGES, check_links)


def check_links(page: Path) -> None:
    for target, anchor in re.findall(r"\]\(([^)#\s]*)(?:#([^)]*))?\)", prose(page)):
        if "://" in target:
            continue
        leads_to = (page.parent / target).resolve() if target else page
        if leads_to.parent == ROOT / "docs" / "reference" and leads_to.stem in GENERATED:
            continue
        assert leads_to.exists(), target
        assert not anchor or anchor in anchors(leads_to), f"{target}#{anchor}"


@pytest.mark.parametrize(
    "token",
    [
        "engine/blocks.py",
        "engine.block.Vectors",
        "cr.simulated",
        "cr.maps.adapt",
        "Solution.opened",
        "solenoid.State.fluxes",
        "valve.spring_preloads",
        "--no-such-option",
        "make tests",
        "STEP_UNSTEADY",
        'initial = "referenced"',
        "tests/test_nothing.py",
        "howto/nothing.md",
        "percent_bound(reference, a_min, a_max)",
        "virtual-lino-2017",
        "test_no_such_thing",
    ],
)
def test_a_wrong_name_is_found(token: str) -> None:
    assert unknown(token, ROOT / "docs" / "index.md") != []


def test_a_name_in_a_wrong_file_is_found() -> None:
    assert misplaced("in `physics/step.py` (`fill_sac`, `drain_cda2`)") == ["drain_cda2 in physics/step.py"]
    assert misplaced("at the end (`physics/components/valve.py`, `numerov_correction`)") == [
        "numerov_correction in physics/components/valve.py"
    ]
