"""Examples run: those in docstrings, and the Python of README and docs.

An example on a page that cannot run here says why in a comment before it, `<!-- not run: REASON -->`; its imports are
still made. Examples of a page follow one another, as a reader would type them, in a folder with the files they name.
"""

from __future__ import annotations

import ast
import doctest
import importlib
import re
import shutil
from pathlib import Path
from typing import Any

import pytest

from commonrail.plugins.new.study import write_new
from tests.test_pages import ROOT

SRC = ROOT / "src"
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
EXAMPLE = re.compile(r"(?:<!-- not run: (?P<reason>[^\n]*) -->\n)?^```python\n(?P<code>.*?)^```", re.S | re.M)
CSV = "time [us],rate [mm3/ms],current [A]\n0,0.0,0.0\n3,0.1,1.2\n6,0.2,1.3\n9,0.3,1.4\n"

# What examples of pages that show an excerpt take for granted.
GIVEN = """
injector = cr.load_injector("virtual-lino-2016")
points = [cr.OperatingPoint("160 MPa", "700 us")]
names, values = ["plunger_needle.k1", "plunger_needle.k3"], np.array([[1.2e8, 9.1e7], [1.3e8, 9.2e7]])
"""


def modules_with_examples() -> list[str]:
    found = [
        path for path in sorted(SRC.rglob("*.py")) if re.search(r"^\s+>>> ", path.read_text(encoding="utf-8"), re.M)
    ]
    return [".".join(path.relative_to(SRC).with_suffix("").parts) for path in found]


@pytest.mark.parametrize("module", modules_with_examples())
def test_examples_in_docstrings(module: str) -> None:
    outcome = doctest.testmod(importlib.import_module(module))
    assert outcome.attempted > 0
    assert outcome.failed == 0


def examples(page: Path) -> list[re.Match[str]]:
    return list(EXAMPLE.finditer(page.read_text(encoding="utf-8")))


def test_every_python_block_is_an_example() -> None:
    for page in PAGES:
        assert len(examples(page)) == len(re.findall(r"^\s*```py", page.read_text(encoding="utf-8"), re.M)), page


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The cases, a short study, an injector and a table, under the names that the pages use."""
    (tmp_path / "cases").symlink_to(ROOT / "cases")
    write_new(tmp_path / "new")
    for path in (tmp_path / "new").iterdir():
        path.rename(tmp_path / path.name)
    study = (tmp_path / "study.toml").read_text(encoding="utf-8")
    (tmp_path / "study.toml").write_text(re.sub("(members|generations) = .*", r"\1 = 8", study), encoding="utf-8")
    shutil.copy(tmp_path / "injector.toml", tmp_path / "my-injector.toml")
    (tmp_path / "evi.csv").write_text(CSV, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("page", [page for page in PAGES if examples(page)], ids=lambda page: page.name)
def test_examples_of_a_page(page: Path, folder: Path) -> None:
    names: dict[str, Any] = {}
    exec("import numpy as np\nimport commonrail as cr\n" + GIVEN, names)
    for example in examples(page):
        code = example["code"]
        if example["reason"]:
            tree = ast.parse(code)
            code = "\n".join(ast.unparse(node) for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom))
        exec(compile(code, page.name, "exec"), names)


def test_a_wrong_example_is_found(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("```python\nimport commonrail as cr\ncr.simulated()\n```\n", encoding="utf-8")
    (example,) = examples(page)
    with pytest.raises(AttributeError):
        exec(example["code"], {})
