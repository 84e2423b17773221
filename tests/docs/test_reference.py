"""Pages of the reference that are generated: they hold all that there is, and no type is left unread."""

from __future__ import annotations

import re
from pathlib import Path

import click
from markupsafe import escape

import commonrail as cr
from commonrail.base.public import places
from commonrail.cli.grammar import cli
from commonrail.report.html import glossary
from commonrail.report.runs_page import runs_html
from tools.reference_pages import GENERATED, SYMBOLS

PAGES = {name: make() for name, make in GENERATED.items()}


def test_every_verb_and_option_is_on_the_page_of_commands() -> None:
    context = click.Context(cli)
    for name in cli.list_commands(context):
        section = PAGES["commands"].partition(f"\n## {name}\n")[2].partition("\n## ")[0]
        command = cli.get_command(context, name)
        assert command is not None
        for parameter in [] if isinstance(command, click.Group) else command.params:
            assert isinstance(parameter, click.Argument) or f"`{parameter.opts[0]}" in section, (name, parameter.opts)


def test_every_parameter_has_a_row_with_its_unit_and_meaning() -> None:
    for path, quantity in cr.models.parameter_quantities().items():
        component, _, key = path.partition(".")
        section = PAGES["parameters"].partition(f"\n## {component}\n")[2].partition("\n## ")[0]
        (row,) = re.findall(rf"^\| `{key}` \|.*$", section, re.M)
        assert f"| {quantity.unit} |" in row
        assert quantity.meaning.split("|")[0].split("<")[0] in row


def test_symbols_are_those_of_parameters() -> None:
    assert set(SYMBOLS) - set(cr.models.parameter_quantities()) == set()


def test_every_public_name_is_on_the_page_of_its_namespace() -> None:
    listed = {
        name: f"commonrail.{page[7:]}".rstrip(".")
        for page, text in PAGES.items()
        if page.startswith("python")
        for name in re.findall(r"heading: (\w+)", text)
    }
    assert listed == places()


def test_keys_of_a_study_are_on_the_page_of_files_with_units_and_choices() -> None:
    assert "| `cylinder_pressure` | quantity [Pa] |" in PAGES["files"]
    assert '| `precision` | "f64" or "f32" | f64 |' in PAGES["files"]
    assert "Undefined" not in PAGES["files"]


def test_every_term_of_the_reports_has_a_page_and_is_explained_in_them() -> None:
    docs = Path(__file__).parents[2] / "docs"
    page = runs_html(Path("runs"), [], Path("runs.html"))
    for term in glossary():
        assert (docs / term.page.partition("#")[0]).is_file(), term
        assert str(escape(term.meaning)) in page
