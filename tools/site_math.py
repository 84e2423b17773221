"""Equations of the site: `$…$` and `$$…$$` of a page, which GitHub renders too, become MathML when the site is built.

Browsers show MathML themselves: no script and no font is loaded. `tools/site_pages.py` calls these functions.
"""

from __future__ import annotations

import re

from latex2mathml.converter import convert

# Code comes first: a dollar in a block or a span of code is not an equation.
_TOKEN = re.compile(
    r"(?P<code>^(?P<fence> *```+).*?^(?P=fence)|`[^`\n]+`)"
    r"|\$\$(?P<display>.+?)\$\$"
    r"|(?<![\w\\$])\$(?P<inline>(?!\s)(?:[^$\n]|\n(?!\n))+?(?<!\s))\$(?![\w$])",
    re.S | re.M,
)
_MARK = "equation{}of{}"


def find_equations(markdown: str) -> list[tuple[str, bool]]:
    """Return LaTeX of the equations of a page in their order, each with True if it has lines of its own."""
    matches = [match for match in _TOKEN.finditer(markdown) if match["code"] is None]
    return [(match["display"] or match["inline"], match["display"] is not None) for match in matches]


def to_mathml(latex: str, display: bool) -> str:
    """Return an equation as MathML."""
    # the library knows `split`, which aligns as `aligned` does; GitHub needs the latter
    text = re.sub(r"\{aligned\}", "{split}", latex.strip())
    mathml = convert(text, display="block" if display else "inline")
    # bars of magnitudes stay as high as the line: the closing one, which has the exponent, would alone grow
    return mathml.replace("<mo>&#x0007C;</mo>", '<mo stretchy="false">&#x0007C;</mo>')


def mark_equations(markdown: str, name: str) -> tuple[str, dict[str, str]]:
    """Replace the equations of a page by placeholders; return the text and the MathML of each placeholder."""
    equations: dict[str, str] = {}
    label = re.sub(r"\W|_", "", name)

    def replace(match: re.Match[str]) -> str:
        if match["code"] is not None:
            return match[0]
        word = _MARK.format(len(equations), label) + "end"
        display = match["display"] is not None
        equations[word] = to_mathml(match["display"] or match["inline"], display)
        return word

    return _TOKEN.sub(replace, markdown), equations


def insert_equations(html: str, equations: dict[str, str]) -> str:
    """Put the equations into the page that Markdown has made."""
    for word, mathml in equations.items():
        html = html.replace(word, mathml)
    return html
