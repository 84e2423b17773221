"""Figures for print: there, readable by their formats, the same bytes each time."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from commonrail.report.plates import PLATES, write_plates
from tests.report.reproduction_sample import record, traces

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def plates(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return write_plates(record(), traces(), tmp_path_factory.mktemp("run") / "figures")


def test_each_plate_is_there_as_svg_and_pdf(plates: list[Path]) -> None:
    assert sorted(p.name for p in plates) == sorted(f"{n}.{kind}" for n in PLATES for kind in ("svg", "pdf"))
    for path in plates:
        if path.suffix == ".pdf":
            text = path.read_bytes()
            assert text.startswith(b"%PDF-")
            assert b"/Type3" not in text  # fonts are embedded as outlines that a printer can hint


@pytest.mark.parametrize(("name", "width"), [("fig4", 84.0), ("fig5", 84.0), ("fig6", 174.0)])
def test_a_plate_has_the_width_of_a_column_or_page(plates: list[Path], name: str, width: float) -> None:
    root = ElementTree.parse(next(p for p in plates if p.name == f"{name}.svg")).getroot()
    assert root.tag == f"{SVG}svg"
    points = float(root.attrib["width"].removesuffix("pt"))
    assert points == pytest.approx(width / 25.4 * 72.0, abs=0.1)  # printed with a tenth of a point


def test_the_same_figures_give_the_same_bytes(plates: list[Path], tmp_path: Path) -> None:
    again = write_plates(record(), traces(), tmp_path)
    assert [p.read_bytes() for p in again] == [p.read_bytes() for p in plates]
