"""Examples in docstrings run; those of README and docs: tests/docs."""

from __future__ import annotations

import doctest
import importlib
import re

import pytest

from tests.test_pages import ROOT

SRC = ROOT / "src"


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
