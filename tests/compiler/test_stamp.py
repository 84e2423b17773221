"""The stamp of a kernel: it covers what is compiled, and nothing else."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import commonrail
from commonrail.compiler.cache import sources_of, stamp_of
from commonrail.physics.variants import Variant

PACKAGE = Path(commonrail.__file__).parent
COMPILED = ("base", "compiler", "engine", "physics")
WORDS = Variant().words
MAKERS = {
    "commonrail.engine.block": (("entries", "f64", "8", *WORDS), ("march_entries", *WORDS)),
    "commonrail.engine.reference_kernels": (("rates_entries", *WORDS), ("march_entries", *WORDS)),
    "commonrail.plugins.export.entry_points": (("entries", *WORDS), ("block_entries", *WORDS)),
}
# As the child process that compiles does it: it imports the maker, and calls it.
MAKE = """
import sys
from commonrail.compiler import lower, laws
from commonrail.physics import law
import {module} as module
{calls}
print(*(name for name in sys.modules if name.startswith("commonrail.")))
print(*{{made.__module__ for made in law._LAWS}})
"""


def run(script: str, path: Path = PACKAGE) -> list[list[str]]:
    """Words of the lines that a script prints, with the package at a path."""
    command = [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(path.parent)!r})\n{script}"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return [line.split() for line in done.stdout.splitlines()]


@pytest.mark.parametrize("module", MAKERS)
def test_all_that_the_compiler_loads_is_covered(module: str) -> None:
    calls = "\n".join(f"module.{maker}(*{words!r})" for maker, *words in MAKERS[module])
    loaded, laws = run(MAKE.format(module=module, calls=calls))
    covered = set(sources_of(module))
    assert set(laws) <= covered
    packages = {f"commonrail.{name}" for name in ("base", "compiler", "engine", "physics", "plugins", "plugins.export")}
    others = {name for name in loaded if not name.startswith("commonrail.base.")} - packages
    assert others <= covered
    assert "commonrail.engine.solution" not in covered  # or the test could not fail


@pytest.fixture
def copied(tmp_path: Path) -> Path:
    """A copy of the packages that decide over kernels."""
    for name in COMPILED:
        shutil.copytree(PACKAGE / name, tmp_path / "commonrail" / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("__init__.py", "__init__.pyi"):
        shutil.copy(PACKAGE / name, tmp_path / "commonrail")
    return tmp_path / "commonrail"


def stamps(package: Path) -> list[str]:
    """Stamps of the core's makers."""
    makers = [name for name in MAKERS if "plugins" not in name]
    script = f"from commonrail.compiler.cache import stamp_of\nprint(*map(stamp_of, {makers}))"
    return run(script, package)[0]


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


def test_a_law_changes_it_and_words_and_results_do_not(copied: Path) -> None:
    before = stamps(copied)
    edit(copied / "engine" / "status.py", "The simulation ended well.", "The simulation has ended well.")
    edit(copied / "engine" / "solution.py", "UNEVEN = 1e-6", "UNEVEN = 2e-6")
    edit(copied / "engine" / "operating_point.py", "LONGEST = 1.0", "LONGEST = 2.0")
    edit(copied / "physics" / "injector.py", "no value for", "there is no value for")
    edit(copied / "physics" / "variants.py", "fed from an ideal rail; set", "fed from an ideal rail: set")  # an error
    edit(copied / "physics" / "flow.py", '"""', '"""Words of a docstring. ')
    assert stamps(copied) == before
    edit(copied / "physics" / "connections.py", "REOPENED = 1e-3", "REOPENED = 2e-3")
    after = stamps(copied)
    assert not set(after) & set(before)
    edit(copied / "physics" / "components" / "contact.py", "\n    return ", "\n    return 1.0 * ")
    assert not set(stamps(copied)) & set(after)


def test_what_a_maker_imports_from_its_package_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = tmp_path / "foreign_kernels"
    package.mkdir()
    (package / "__init__.py").write_text("", encoding="utf-8")
    (package / "maker.py").write_text("from .law import law\n", encoding="utf-8")
    (package / "law.py").write_text("def law(x):\n    return 2.0 * x\n", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    before = stamp_of("foreign_kernels.maker")
    edit(package / "law.py", "2.0", "2.1")
    stamp_of.cache_clear()
    assert stamp_of("foreign_kernels.maker") != before
