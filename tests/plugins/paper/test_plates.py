"""Figures for print: there, readable by their formats, the same bytes each time."""

from __future__ import annotations

import json
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from commonrail.base.errors import InputError
from commonrail.plugins.paper.page import PLATES, draw_plates, make_plates
from commonrail.report.page import write_report
from tests.report.reproduction_sample import record, traces

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def plates() -> dict[str, bytes]:
    return make_plates(record(), traces())


def test_each_plate_is_there_as_svg_and_pdf(plates: dict[str, bytes]) -> None:
    assert sorted(plates) == sorted(f"{n}.{kind}" for n in PLATES for kind in ("svg", "pdf"))
    for name, text in plates.items():
        if name.endswith(".pdf"):
            assert text.startswith(b"%PDF-")
            assert b"/Type3" not in text  # fonts are embedded as outlines that a printer can hint


@pytest.mark.parametrize(("name", "width"), [("fig4", 84.0), ("fig5", 84.0), ("fig6", 174.0)])
def test_a_plate_has_the_width_of_a_column_or_page(plates: dict[str, bytes], name: str, width: float) -> None:
    root = ElementTree.fromstring(plates[f"{name}.svg"])
    assert root.tag == f"{SVG}svg"
    points = float(root.attrib["width"].removesuffix("pt"))
    assert points == pytest.approx(width / 25.4 * 72.0, abs=0.1)  # printed with a tenth of a point


def test_the_same_figures_give_the_same_bytes(plates: dict[str, bytes]) -> None:
    assert make_plates(record(), traces()) == plates


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Folder of a reproduction without figures for print."""
    (tmp_path / "reproduce.json").write_text(json.dumps(record()))
    labels = ["experiment", *record()["labels"]]
    lines = [",".join(["seed", "data", "time [us]", *(f"{label} [mm3/ms]" for label in labels)])]
    for seed, sets in traces().items():
        for name, curves in sets.items():
            columns = zip(curves["time_s"] * 1e6, *(curves[label] * 1e6 for label in labels), strict=True)
            lines += [f"{seed},{name}," + ",".join("" if v != v else repr(float(v)) for v in row) for row in columns]
    (tmp_path / "traces.csv").write_text("\n".join(lines) + "\n")
    return tmp_path


def test_without_matplotlib_a_sentence_names_the_extra(
    run: Path, plates: dict[str, bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as without:
        without.setitem(sys.modules, "matplotlib", None)
        sentence = draw_plates(run)
        page = write_report(run).read_text(encoding="utf-8")
    assert "'commonrail[plates]'" in sentence
    assert f"`commonrail report {run}` draws them" in sentence
    assert not (run / "figures").exists()
    assert "For print" not in page
    monkeypatch.setattr("commonrail.plugins.paper.page.make_plates", lambda *read: plates)
    assert draw_plates(run) == ""
    assert len(list((run / "figures").iterdir())) == 6
    assert "figures/fig6.pdf" in write_report(run).read_text(encoding="utf-8")


def test_a_broken_record_has_no_plates_and_says_so(run: Path) -> None:
    broken = record()
    del broken["convergence"]
    (run / "reproduce.json").write_text(json.dumps(broken))
    with pytest.raises(InputError, match="convergence"):
        draw_plates(run)


@pytest.mark.slow  # a contract of tests/test_imports.py holds that nothing else names it
def test_nothing_but_the_plates_needs_matplotlib() -> None:
    code = """
import importlib, pkgutil, sys
sys.modules["matplotlib"] = None
import commonrail
for module in pkgutil.walk_packages(commonrail.__path__, "commonrail."):
    if module.name not in {"commonrail.plugins.paper.plates", "commonrail.engine.cuda"}:
        importlib.import_module(module.name)
for name in commonrail.__all__:
    getattr(commonrail, name)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
