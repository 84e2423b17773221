"""The report whose main chart simulates, in a real browser: its J and curves against the engine's; its still twin."""

from __future__ import annotations

import importlib.util
import json
import shutil
from collections.abc import Iterator
from itertools import product
from pathlib import Path

import numpy as np
import pytest

import commonrail as cr
from commonrail.base.errors import ConfigurationError
from commonrail.data.curves.data import RateData
from commonrail.data.simulator import Simulator
from commonrail.plugins.page import live
from commonrail.report.page import write_report
from commonrail.runs.fit import calibrate_into
from commonrail.runs.folder import TRACES, read_fit
from commonrail.runs.traces import read_traces
from tests.map_study import map_study
from tools.browser import CHROMIUM, Browser, browsing

ROOT = Path(__file__).parents[3]
LARGEST, LARGEST_STILL = 600_000, 300_000  # of a report that simulates, and of one that does not [bytes]

pytestmark = [
    pytest.mark.process,
    pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium on this machine"),
    pytest.mark.skipif(importlib.util.find_spec("websocket") is None, reason="websocket-client is not installed"),
    pytest.mark.skipif(importlib.util.find_spec("ziglang") is None, reason="ziglang is not installed"),
]


def shortened(case: str, folder: Path, method: str) -> Path:
    """Run folder of a case, of a search that is as short as it may be."""
    text = (ROOT / "cases" / case / "study.toml").read_text(encoding="utf-8")
    (folder / "study.toml").write_text(text.partition("[optimiser]")[0] + method, encoding="utf-8")
    shutil.copytree(ROOT / "cases" / case / "data", folder / "data")
    calibrate_into(folder / "run", cr.load_study(folder / "study.toml"))
    write_report(folder / "run")
    return folder / "run"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    method = "[optimiser]\nmembers = 14\ngenerations = 3\n"
    return shortened("paper", tmp_path_factory.mktemp("live"), method)


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with browsing() as found:
        yield found


@pytest.fixture
def report(browser: Browser, run: Path) -> Iterator[Browser]:
    """The report as it opens; it must not have complained by the end of a test."""
    browser.complaints.clear()
    browser.resize(1280, 900)
    opened(browser, run)
    yield browser
    assert browser.complaints == []


def opened(browser: Browser, run: Path) -> None:
    browser.open((run / "report.html").as_uri())
    browser.until("live.settled()")


def box(browser: Browser, selector: str) -> list[float]:
    """Left, top, width and height of an element in the window [px]."""
    return list(
        browser.evaluate(
            f"(({{ left, top, width, height }}) => [left, top, width, height])"
            f"(document.querySelector({selector!r}).getBoundingClientRect())"
        )
    )


def mouse(browser: Browser, kind: str, x: float, y: float, count: int = 1, held: bool = True) -> None:
    button, buttons = ("left", int(kind != "mouseReleased")) if held else ("none", 0)
    browser.call(
        "Input.dispatchMouseEvent", type=kind, x=x, y=y, button=button, buttons=buttons, clickCount=count * held
    )
    browser.evaluate("new Promise(requestAnimationFrame)")  # a page hears of a moved mouse once a frame


def drag(browser: Browser, selector: str, start: tuple[float, float], end: tuple[float, float]) -> None:
    """Drag between two places of an element, in shares of its width and height."""
    left, top, width, height = box(browser, selector)
    places = [(left + x * width, top + y * height) for x, y in (start, end)]
    mouse(browser, "mousePressed", *places[0])
    mouse(browser, "mouseMoved", *places[1])
    mouse(browser, "mouseReleased", *places[1])


def touch(browser: Browser, kind: str, *places: tuple[float, float]) -> None:
    browser.call("Input.dispatchTouchEvent", type=kind, touchPoints=[{"x": x, "y": y} for x, y in places])


def ticks(browser: Browser, panel: int = 0) -> list[float]:
    """Numbers of the horizontal axis of the main chart."""
    found = browser.evaluate(
        "[...charts.shown(charts.of(document.getElementById('figure-0'))).panels.at(-1).group"
        ".querySelectorAll('.xs text')].map((t) => t.textContent)"
    )
    return [float(text.replace("−", "-")) for text in found]


BAR = '.forest .forest-bar[data-name="plunger_needle.k6"]'


def test_a_dragged_point_simulates_curve_error_and_j(report: Browser, run: Path) -> None:
    study, best = read_fit(run)
    drag(report, BAR, (0.5, 0.5), (0.8, 0.5))
    report.until("live.settled()")
    value = report.evaluate("live.values['plunger_needle.k6']")
    parameter = next(p for p in study.space.parameters if p.name == "plunger_needle.k6")
    assert value == pytest.approx(parameter.lower + 0.8 * (parameter.upper - parameter.lower), rel=0.01)
    simulator = Simulator(study.injector.with_values({**best, "plunger_needle.k6": value}), (), study.time_step)
    curves = [d for d in study.data if isinstance(d, RateData)]
    scores = {d.name: d.score(simulator) for d in curves}
    assert report.evaluate("live.now") == pytest.approx({name: s.j for name, s in scores.items()}, rel=1e-9)
    rate, error = report.evaluate("""charts.shown(charts.of(document.getElementById('figure-0'))).panels.map((panel) =>
        panel.own[0]._points.map(([, y]) => panel.value(y)))""")
    first = curves[0]
    pixel = 70.0 / 2000.0  # of some 70 mm³/ms on 200 px, in tenths
    assert np.max(np.abs(np.array(rate) - 1e6 * scores[first.name].values)) < pixel
    assert np.max(np.abs(np.array(error) - 1e6 * (scores[first.name].values - first.rate))) < pixel
    assert f"J {scores[first.name].j:.1f}" in report.evaluate("document.getElementById('live').innerText")
    report.evaluate("document.querySelector('#live button').click()")
    assert report.evaluate("document.querySelectorAll('svg.moved, .changed').length") == 0
    assert report.evaluate("Object.keys(live.values).length") == 0


def test_a_point_is_moved_by_keys_and_stopped_by_the_run_s_constraint(report: Browser) -> None:
    report.evaluate(f"document.querySelector({BAR!r}).focus()")
    before = report.evaluate("live.model.present['plunger_needle.k6']")
    report.press("ArrowLeft", "ArrowLeft", 37)
    report.until("live.settled()")
    low, high = report.evaluate("live.model.bounds['plunger_needle.k6']")
    assert report.evaluate("live.values['plunger_needle.k6']") == pytest.approx(before - 0.01 * (high - low), rel=1e-9)
    report.evaluate("live.take('plunger_needle.k7', live.model.bounds['plunger_needle.k7'][1])")
    assert "run's constraint" in report.evaluate("document.getElementById('live').innerText")


def test_the_cursor_crosses_all_panels_and_the_curves_are_enlarged_together(report: Browser) -> None:
    pane = "#figure-0 svg.wide .panel rect"
    left, top, width, height = box(report, pane)
    mouse(report, "mouseMoved", left + 0.5 * width, top + 0.5 * height, held=False)
    readers = (
        "[...document.querySelectorAll('#figure-0 svg.wide .reader')].map((e) => e.getAttribute('d').split(' ')[0])"
    )
    first, second = report.evaluate(readers)
    assert first == second != ""
    told = report.evaluate("document.querySelector('.readout').textContent")
    assert "calibrated" in told.partition("error, mm³/ms")[0]
    assert "calibrated" in told.partition("error, mm³/ms")[2]
    before = ticks(report)
    drag(report, pane, (0.5, 0.5), (0.75, 0.51))
    enlarged = ticks(report)
    assert max(enlarged) - min(enlarged) < 0.3 * (max(before) - min(before))
    heights = report.evaluate("charts.list[0].panels[0].view.y")
    curves = report.evaluate("charts.list[0].panels[0].y")
    assert heights[1] - heights[0] < curves[1] - curves[0]  # scaled to what is in sight
    for count in (1, 2):
        for kind in ("mousePressed", "mouseReleased"):
            mouse(report, kind, left + 0.3 * width, top + 0.3 * height, count)
    assert ticks(report) == before
    report.evaluate("charts.list[0].svg.focus()")
    report.press("+")
    assert max(ticks(report)) - min(ticks(report)) < max(before) - min(before)
    report.press("0")
    assert ticks(report) == before


def test_two_fingers_enlarge_a_chart_on_a_telephone(report: Browser, run: Path) -> None:
    report.resize(390, 844, phone=True)
    report.call("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=2)
    try:
        opened(report, run)
        report.evaluate("document.getElementById('figure-0').scrollIntoView()")
        left, top, width, height = box(report, "#figure-0 svg.narrow .panel rect")
        before, y = ticks(report), top + 0.5 * height
        touch(report, "touchStart", (left + 0.4 * width, y))
        touch(report, "touchStart", (left + 0.4 * width, y), (left + 0.6 * width, y))
        touch(report, "touchMove", (left + 0.1 * width, y), (left + 0.9 * width, y))
        touch(report, "touchEnd")
        report.until("charts.shown(charts.of(document.getElementById('figure-0'))).panels[0].zoomed")
        enlarged = ticks(report)
        assert max(enlarged) - min(enlarged) < 0.5 * (max(before) - min(before))
        assert report.evaluate("document.documentElement.scrollWidth") <= 390
    finally:
        report.call("Emulation.setTouchEmulationEnabled", enabled=False)


def test_legend_and_files(report: Browser, run: Path) -> None:
    report.evaluate(
        "document.querySelector('#figure-0 svg.wide .entry[data-key=rigid]').dispatchEvent(new Event('click'))"
    )
    csv = report.evaluate("charts.list[0].csv")
    assert "calibrated" in csv
    assert "rigid body" not in csv
    rows = [line.split(",") for line in csv.splitlines() if line.startswith('"rate, mm³/ms","calibrated"')]
    peak = max(float(row[-1]) for row in rows)
    best = read_traces(run / TRACES)["160 MPa"]["best"]
    assert peak == pytest.approx(1e6 * np.max(best), abs=0.05)
    assert report.evaluate("(async () => (await charts.list[0].png()).type)()") == "image/png"
    assert report.evaluate("charts.list[0].text").startswith("<svg")


def test_sizes_and_policy(run: Path) -> None:
    text = (run / "report.html").read_text(encoding="utf-8")
    assert len(text.encode()) < LARGEST
    assert "script-src 'unsafe-inline' 'wasm-unsafe-eval';" in text
    write_report(run, live=False)
    still = (run / "report.html").read_text(encoding="utf-8")
    write_report(run)
    assert len(still.encode()) < LARGEST_STILL
    assert "wasm" not in still


def test_without_a_compiler_the_figure_stands_still(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(variant: cr.Variant) -> bytes:
        raise ConfigurationError("no zig")

    monkeypatch.setattr(live, "wasm_module", refuse)
    record = json.loads((run / "result.json").read_text(encoding="utf-8"))
    assert live.live_chart(record, run) == ""


def test_a_dragged_point_simulates_a_map_and_its_j(browser: Browser, tmp_path: Path) -> None:
    """Four quantities of two rail pressures, those of the injector's own simulation changed by some percent."""
    text = map_study().replace('"cri2-16"', '"virtual-lino-2016"')
    lower, upper = (f"{share * 100:.0f} %" for share in (0.8, 1.2))
    text = text.replace('lower = "190 um"', f'below = "{lower}"').replace('upper = "240 um"', f'above = "{upper}"')
    (tmp_path / "study.toml").write_text(text, encoding="utf-8")
    rails, times = (120.0, 80.0), (500.0, 900.0)
    injector = cr.load_injector("virtual-lino-2016")
    lines = ["rail_pressure [MPa],energising_time [us],quantity [mm3]"]
    for rail, time in product(rails, times):
        point = cr.OperatingPoint(rail * 1e6, time * 1e-6, 0.5e6, 0.1e6)
        lines.append(f"{rail},{time},{1.03e9 * cr.simulate(injector, point).injected_volume}")
    (tmp_path / "map.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    calibrate_into(tmp_path / "run", cr.load_study(tmp_path / "study.toml"))
    write_report(tmp_path / "run")
    browser.complaints.clear()
    browser.resize(1280, 900)
    opened(browser, tmp_path / "run")
    name = "control_chamber.a_hole_diameter"
    drag(browser, f'.forest .forest-bar[data-name="{name}"]', (0.5, 0.5), (0.7, 0.5))
    browser.until("live.settled()")
    study, _ = read_fit(tmp_path / "run")
    (data,) = study.data
    assert isinstance(data, cr.QuantityData)
    moved = study.injector.with_values({name: browser.evaluate(f"live.values['{name}']")})
    values = data.simulated(Simulator(moved, (), study.time_step), np.empty((1, 0)))[0]
    assert browser.evaluate("live.now.map") == pytest.approx(float(data.misfit(values)), rel=1e-4)
    drawn = browser.evaluate("""charts.shown(charts.of(document.getElementById('figure-0'))).panels[0].own.map((path) =>
        path._points.map(([, y]) => charts.list[0].panels[0].value(y)))""")
    found: dict[float, list[float]] = {}
    for point, value in zip(data.points, values, strict=True):
        found.setdefault(point.initial_pressures()[0], []).append(1e9 * value)
    assert np.array(drawn) == pytest.approx(np.array([found[80e6], found[120e6]]), abs=0.1)  # a tenth of a pixel: 0.05
    assert browser.complaints == []
