"""Page of the catalogue's injectors: its figures are the engine's, and what is not measured is said."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

import commonrail as cr
from commonrail.engine.status import Status
from commonrail.plugins.catalogue.page import SERVO, Exhibit, exhibit, gallery_html
from commonrail.readers.injector import injector_catalogue
from commonrail.report.fit.tables import MARKS
from tests.cli.conftest import run_command
from tests.report.test_build import Page


@pytest.fixture(scope="module")
def virtual() -> Exhibit:
    return exhibit("virtual-lino-2016", cr.load_injector("virtual-lino-2016"))


def test_figures_are_those_of_a_simulation(virtual: Exhibit) -> None:
    page = gallery_html([virtual], "0")
    for point, (name, _) in zip(SERVO, virtual.solutions.items(), strict=True):
        solution = cr.simulate(cr.load_injector("virtual-lino-2016"), point)
        assert name == f"{solution.channels['rail_pressure'][0] * 1e-6:g} MPa"
        assert f">{solution.injected_volume * 1e9:.2f}<" in page
        assert f">{(solution.closing - 700e-6) * 1e6:.0f}<" in page


def test_marks_and_sources_are_those_of_the_file(virtual: Exhibit) -> None:
    page = gallery_html([virtual], "0")
    sources = virtual.injector.sources.values()
    counts = Counter(source.mark for source in sources)
    assert f" {len(sources)} values" in page
    for mark, count in counts.items():
        assert f"{MARKS[mark]}: {count}" in page
    for source in sources:
        assert source.text.replace("'", "&#39;") in page


def test_what_is_synthetic_is_said(virtual: Exhibit) -> None:
    text = Page(gallery_html([virtual], "0")).text
    assert "Synthetic, not" in text
    assert virtual.injector.synthetic in text


@pytest.mark.slow  # kernels of a rail volume and of a direct-acting injector
def test_the_verb_shows_all_injectors(tmp_path: Path) -> None:
    out = tmp_path / "gallery.html"
    record = run_command("catalogue", "injectors", "--report", out, "--json").record
    assert record["injectors"] == injector_catalogue()
    page = Page(out.read_text(encoding="utf-8"))
    assert page.count("h2") == len(record["injectors"])
    assert "current trace" in page.text
    assert page.text.count(Status.OK.sentence) == (len(record["injectors"]) - 1) * len(SERVO) + 3
    assert not [a for _, a in page.tags if "src" in a]


def test_a_search_that_finds_nothing_is_a_sentence(tmp_path: Path) -> None:
    done = run_command("catalogue", "injectors", "--report", tmp_path / "g.html", "--search", "no such")
    assert done.status == 2
    assert '"no such"' in done.sentence
    assert not (tmp_path / "g.html").exists()
