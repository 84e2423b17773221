"""Notebooks of the documentation run, and no output but a figure is long."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

nbformat = pytest.importorskip("nbformat", reason="nbformat comes with the extra dev")
nbclient = pytest.importorskip("nbclient", reason="nbclient comes with the extra dev")
pytest.importorskip("ipykernel", reason="ipykernel comes with the extra dev")

from tests.docs.pages import environment  # noqa: E402
from tools.notebooks import DOCS, NOTEBOOKS, run_notebook  # noqa: E402

NOTEBOOK = DOCS / "notebooks" / "injector.ipynb"
TUTORIALS = [path for path in NOTEBOOKS if path != NOTEBOOK]
LONGEST = 20_000  # letters of an output that is no figure
LONGEST_FIGURE = 200_000
MACHINE = re.compile(r"(?<![\w.}])/(tmp|home|root|work|Users|var)/\w")  # begins a path of the machine that ran it
LARGEST = 150_000  # bytes of a notebook with its outputs: a clone and the site carry all of them


@pytest.fixture(scope="module")
def outputs() -> list[list[Any]]:
    """Outputs of each code cell, after the notebook has been run."""
    notebook = run_notebook(NOTEBOOK)
    return [cell.outputs for cell in notebook.cells if cell.cell_type == "code"]


def contents(output: Any) -> str:
    """All forms of an output, as the file holds them."""
    return json.dumps(output.get("data", output.get("text", "")))


@pytest.mark.process
def test_ten_cells_run_and_show_something(outputs: list[list[Any]]) -> None:
    assert len(outputs) == 10
    assert all(any(output.output_type != "error" for output in own) for own in outputs)


@pytest.mark.process
def test_outputs_are_short_but_for_figures(outputs: list[list[Any]]) -> None:
    for number, own in enumerate(outputs, start=1):
        for output in own:
            text = contents(output)
            assert len(text) < (LONGEST_FIGURE if "<svg" in text else LONGEST), number


@pytest.mark.process
def test_parameter_study_map_dwell_and_fit_are_drawn(outputs: list[list[Any]]) -> None:
    drawn = ["".join(map(contents, own)) for own in outputs]
    for number, words in {
        2: "Anatomy of the injection",
        4: "spring",
        7: "Energising time of",
        8: "dwell",
        10: "160 MPa",
    }.items():
        assert "<svg" in drawn[number - 1], number
        assert words in drawn[number - 1], number


@pytest.mark.process
def test_the_calibration_shows_a_bar_and_finds_the_values(outputs: list[list[Any]]) -> None:
    assert "<progress" in "".join(map(contents, outputs[8]))
    (table,) = [output.text for output in outputs[9] if output.output_type == "stream"]
    found = {line.split()[1]: float(line.split()[3]) for line in table.splitlines()[1:]}
    # the bench's values, known to the rounding of the printed table
    assert found["valve.spring_preload"] == pytest.approx(70.0, rel=0.02)
    assert found["control_chamber.z_hole_diameter"] == pytest.approx(215e-6, rel=0.01)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_kept_with_its_outputs_and_is_small(path: Path) -> None:
    cells = [cell for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code"]
    assert any(cell.outputs for cell in cells)
    assert not any(output.output_type == "error" for cell in cells for output in cell.outputs)
    assert path.stat().st_size < LARGEST
    assert not MACHINE.search("".join(contents(output) for cell in cells for output in cell.outputs))


@pytest.mark.slow
@pytest.mark.process
@pytest.mark.parametrize("path", TUTORIALS, ids=lambda path: path.stem)
def test_a_tutorial_runs(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in environment(tmp_path / "bin").items():
        monkeypatch.setenv(name, value)  # `!commonrail` is this tree's
    printed = "".join(contents(output) for cell in run_notebook(path).cells for output in cell.get("outputs", []))
    assert "Traceback" not in printed
    assert "commonrail: " not in printed  # an error of a command line
