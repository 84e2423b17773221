"""Equations of the pages: found outside code only, and each becomes MathML without a leftover of LaTeX."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

pytest.importorskip("latex2mathml", reason="installed by the extras dev and docs")

from tests.docs.pages import PAGES
from tools.site_math import find_equations, insert_equations, mark_equations, to_mathml


def test_code_is_left_alone() -> None:
    text = 'Price `$HOME$` and $x_1$:\n\n```sh\neval "$(a)" $b$\n```\n\n$$\ny = 2\n$$\n'
    assert find_equations(text) == [("x_1", False), ("\ny = 2\n", True)]
    marked, equations = mark_equations(text, "a/b.md")
    assert "$HOME$" in marked
    assert "$b$" in marked
    assert len(equations) == 2
    html = insert_equations(marked, equations)
    assert "<msub><mi>x</mi><mn>1</mn></msub>" in html
    assert 'display="block"' in html


def test_ten_equations_do_not_mix() -> None:
    marked, equations = mark_equations(" ".join(f"$x_{{{i}}}$" for i in range(12)), "a.md")
    assert [int(n) for n in re.findall(r"<mn>(\d+)</mn>", insert_equations(marked, equations))] == list(range(12))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_equation_of_a_page_becomes_mathml(page: Path) -> None:
    for latex, display in find_equations(page.read_text(encoding="utf-8")):
        mathml = to_mathml(latex, display)
        assert not re.search(r"\\|<mi>&</mi>", mathml), latex
