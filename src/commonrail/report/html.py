"""Pages from templates; every text from outside is escaped."""

from __future__ import annotations

import functools
import re
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup, escape

from commonrail.report.draw import plotly_script

__all__ = ["breakable", "render"]


@functools.cache
def _environment() -> Environment:
    # Autoescaping for whatever the template is called: a name in a study may hold anything.
    environment = Environment(
        loader=PackageLoader("commonrail.report"),
        autoescape=select_autoescape(default=True, default_for_string=True),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["drawing"] = Markup
    environment.filters["breakable"] = breakable
    return environment


def breakable(name: str) -> Markup:
    """A dotted name, escaped, that may be broken after its dots and underscores."""
    return Markup(re.sub(r"([._])", r"\1<wbr>", str(escape(name))))


def render(template: str, **values: Any) -> str:
    """Fill a template of the folder ``templates``; plotly's script goes in once."""
    page = _environment().get_template(template)
    return page.render(plotly_script=Markup(plotly_script()), **values)
