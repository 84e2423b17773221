"""Pages from templates; every text from outside is escaped."""

from __future__ import annotations

import functools
import re
import tomllib
from importlib.resources import files
from typing import Any, NamedTuple

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup, escape

from commonrail.base.table import Table
from commonrail.base.text import MISSING
from commonrail.report.figure import dark_rules

# Letters of a table in a row: on a telephone 390 px wide, and times the size [pt] on A4 between its margins.
TELEPHONE, PAPER = 50.0, 930.0
KEPT = 18  # letters of a cell that stay on one line
NEVER_BROKEN = 14  # letters below which the whole cell does, as macros.html has it


class Term(NamedTuple):
    """Term of the reports: its meaning, and the page of the documentation that says more."""

    name: str
    meaning: str
    page: str


def glossary() -> list[Term]:
    """Terms of the reports; every page explains them at its end."""
    text = (files(CORE) / "glossary.toml").read_text(encoding="utf-8")
    return [Term(**term) for term in tomllib.loads(text)["term"]]


CORE = "commonrail.report"  # package whose folder ``templates`` has the templates that others extend


@functools.cache
def _environment(package: str = CORE) -> Environment:
    # Autoescaping for whatever the template is called: a name in a study may hold anything.
    environment = Environment(
        loader=ChoiceLoader([PackageLoader(name) for name in dict.fromkeys((package, CORE))]),
        autoescape=select_autoescape(default=True, default_for_string=True),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update({f.__name__: f for f in (breakable, unbroken, print_size, is_long, css_text)})
    environment.globals["glossary"] = glossary()
    environment.globals["dark_figures"] = Markup(dark_rules())
    environment.globals["dark_theme_figures"] = Markup(dark_rules(':root[data-theme="dark"]'))  # chosen in the page
    return environment


def breakable(name: str) -> Markup:
    """A dotted name, escaped, that may be broken after its dots and underscores."""
    return Markup(re.sub(r"([._])", r"\1<wbr>", str(escape(name))))


def css_text(text: str) -> Markup:
    """A string of CSS, every letter but the plainest as its code, so that none ends string or element."""
    return Markup('"{}"').format(Markup("".join(c if c.isascii() and c.isalnum() else f"\\{ord(c):06x}" for c in text)))


def unbroken(text: str) -> Markup:
    """Cell of numbers, escaped, in which each stays on a line with its unit; a range may be broken at its "to"."""
    if len(text) < NEVER_BROKEN:
        return escape(text)
    word = Markup('<span class="word">{}</span>')
    parts = text.split(" to ")
    return Markup(" to ").join(word.format(end) if len(end) <= KEPT else escape(end) for end in parts)


def print_size(table: Table) -> str:
    """Size of letters [pt] at which a table fits a sheet of paper."""
    return f"{min(8.5, max(5.5, PAPER / max(_letters(table), 1.0))):.2g}pt"


def is_long(table: Table) -> bool:
    """True for a table too wide for a telephone: there each row is set as lines of its own."""
    return _letters(table) > TELEPHONE


def _letters(table: Table) -> float:
    """Width of a table in letters: of each column the longest word that is not broken."""
    widths = []
    for i, head in enumerate(table.columns):
        cells = [row[i].plain for row in table.rows if row[i].plain != MISSING]
        words = [word for text in cells for word in (_unbroken_words(text, i >= table.texts))]
        widths.append(max(map(len, [*head.split(), *words]), default=1) + 1.5)
    return sum(widths)


def _unbroken_words(text: str, is_number: bool) -> list[str]:
    """Parts of a cell that stay on one line."""
    if len(text) <= KEPT:
        return [text]
    parts = text.split(" to ") if is_number else []
    return parts if parts and max(map(len, parts)) <= KEPT else text.split()


def render(template: str, package: str = CORE, **values: Any) -> str:
    """Page from a template in the folder ``templates`` of a package, such as ``__package__`` of a plug-in.

    Templates that it extends or includes may be in the folder of `CORE`; `values` fill it.
    """
    return _environment(package).get_template(template).render(**{"dated": "", "record": {}, **values})
