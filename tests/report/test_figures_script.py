"""Zoom and readout of figures in a real browser."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path

import pytest

from commonrail.base.chart import Figure, Panel, Series
from commonrail.base.errors import InputError
from commonrail.report.figure import figure_html
from commonrail.report.html import render
from commonrail.report.pdf import browser

# Drags over the middle half of the first panel, reads off in the middle, and returns by a double click.
SCRIPT = """<script>
var panel = document.querySelector("svg.wide .panel"), pane = panel.querySelector(".pane"), told = [];
var TEXTS = panel.querySelector("[data-log]") ? ".ys text" : ".xs text";
panel.setPointerCapture = function () {};
function at(kind, across, down) {
  var box = panel.querySelector("rect").getBoundingClientRect();
  var place = { clientX: box.left + across * box.width, clientY: box.top + down * box.height };
  panel.dispatchEvent(new PointerEvent(kind, Object.assign({ pointerType: "mouse", button: 0, bubbles: true }, place)));
}
function texts() {
  return Array.from(panel.querySelectorAll(TEXTS)).map(function (t) { return t.textContent; }).join(",");
}
told.push(texts());
at("pointermove", 0.5, 0.5);
told.push(document.querySelector(".readout").textContent.replace(/\\n/g, " / "));
at("pointerdown", 0.25, 0.25); at("pointermove", 0.5, 0.5); at("pointerup", 0.75, 0.75);
told.push(texts());
told.push(pane.getAttribute("viewBox").split(" ").map(Math.round).join(" "));
panel.dispatchEvent(new MouseEvent("dblclick", { bubbles: true }));
told.push(texts());
document.title = told.join(" | ");
</script></body>"""


@pytest.fixture
def command() -> str:
    """Command of the browser."""
    try:
        return browser()
    except InputError:
        pytest.skip("no Chromium, Chrome or Edge on this machine")


def told(command: str, tmp_path: Path, panel: Panel) -> list[str]:
    """Texts of the axis, values in the middle, texts and view of the enlarged panel, and texts after a double click."""
    figure = Figure("f", "", "x", (panel,))
    made = render("picture.html", title="t", kind="Figures", synthetic=[], figures=[(figure, figure_html(figure, "f"))])
    page = tmp_path / "page.html"
    page.write_text(made.replace("</body>", SCRIPT), encoding="utf-8")
    options = ["--headless", "--disable-gpu", "--window-size=1280,900", f"--user-data-dir={tmp_path / 'profile'}"]
    options += ["--no-sandbox"] if getattr(os, "geteuid", lambda: 1)() == 0 else []
    done = subprocess.run(
        [command, *options, "--dump-dom", page.as_uri()], capture_output=True, text=True, timeout=120, check=False
    )
    (title,) = re.findall(r"<title>(.*?)</title>", done.stdout)
    return title.split(" | ")


@pytest.mark.process
def test_a_figure_is_enlarged_read_off_and_returned(command: str, tmp_path: Path) -> None:
    line = Series("straight", "best", (0.0, 1000.0), (0.0, 100.0))
    first, read, enlarged, box, again = told(command, tmp_path, Panel("y", (line,)))
    assert first == again == "0,200,400,600,800,1000"
    # a straight line through the middle: 50 at 500, to a tenth of a pixel of some 200
    assert re.match(r"x 500 / y /   straight (49\.9|50\.0|50\.1)", read), read
    assert enlarged == "300,400,500,600,700"
    x, y, width, height = map(int, box.split())
    assert width == pytest.approx(2 * x, abs=2)  # the middle half of the panel
    assert height == pytest.approx(2 * y, abs=2)


@pytest.mark.process
def test_a_logarithmic_axis_is_read_off_and_keeps_its_ticks(command: str, tmp_path: Path) -> None:
    line = Series("decades", "best", (0.0, 1000.0), (1.0, 10_000.0))
    first, read, *_, again = told(command, tmp_path, Panel("y", (line,), logarithmic=True))
    assert first == again
    found = re.search(r"decades ([\d.]+)", read)
    assert found
    assert float(found[1]) == pytest.approx(100.0, rel=0.01)  # a tenth of a pixel of some 50 px a decade is 0.5 %
