"""A user's way in the browser, from files to a DCM, past a killed server and with a second window."""

from __future__ import annotations

import importlib.util
import json
import time
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from commonrail.plugins.app.preview import Worker
from commonrail.plugins.app.project import EFFORTS
from tests.plugins.app.server import Served, end, is_alive, serving, write_bench
from tests.waiting import wait_until
from tools.browser import CHROMIUM, Browser, browsing

ROOT = Path(__file__).parents[3]
_CASE, _PLAN = ROOT / "cases/cri2-16/data/quantity.csv", ROOT / "examples/test-plan/results.csv"

pytestmark = [
    pytest.mark.process,
    pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium on this machine"),
    pytest.mark.skipif(importlib.util.find_spec("websocket") is None, reason="websocket-client is not installed"),
    pytest.mark.skipif(importlib.util.find_spec("nicegui") is None, reason="nicegui is not installed"),
]


class Window:
    """A browser on the app, driven by what is read on the page."""

    def __init__(self, browser: Browser) -> None:
        self.browser = browser

    def sees(self, condition: str) -> bool:
        try:
            return bool(self.browser.evaluate(f"Boolean({condition})"))
        except RuntimeError:  # the page is being built
            return False

    def wait(self, condition: str) -> None:
        wait_until(lambda: (time.sleep(0.2), self.sees(condition))[1], f"{condition} holds on the page")

    def read(self, words: str) -> None:
        self.wait(f"document.body.innerText.includes({json.dumps(words)})")

    def press(self, words: str, kind: str = "button, a, .q-tab, .q-item") -> None:
        find = (
            f"[...document.querySelectorAll({json.dumps(kind)})].find((e) => "
            f"e.getClientRects().length && !e.disabled && e.textContent.includes({json.dumps(words)}))"
        )
        self.wait(find)
        self.browser.evaluate(f"{find}.click()")

    def fill(self, label: str, text: str) -> None:
        field = f"document.querySelector('input[aria-label={json.dumps(label)}]')"
        self.wait(field)
        self.browser.evaluate(f"{field}.focus(), {field}.select()")
        self.browser.call("Input.insertText", text=text)
        self.browser.press("Enter", number=13)

    def choose(self, label: str, option: str) -> None:
        field = f"document.querySelector('input[aria-label={json.dumps(label)}]')"
        self.wait(field)
        self.browser.evaluate(f"{field}.scrollIntoView({{block: 'center'}})")
        box = self.browser.evaluate(f"JSON.parse(JSON.stringify({field}.closest('.q-field').getBoundingClientRect()))")
        place = {"x": box["x"] + box["width"] / 2, "y": box["y"] + box["height"] / 2, "button": "left", "clickCount": 1}
        for kind in ("mousePressed", "mouseReleased"):
            self.browser.call("Input.dispatchMouseEvent", type=kind, **place)
        self.press(option, ".q-menu .q-item")

    def drop(self, label: str, *paths: Path) -> None:
        place = f"document.querySelector('[aria-label={json.dumps(label)}] input[type=file]')"
        self.wait(place)
        found = self.browser.call("Runtime.evaluate", expression=place)["result"]["objectId"]
        self.browser.call("DOM.setFileInputFiles", files=[str(path) for path in paths], objectId=found)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("app") / "project"


@pytest.fixture(scope="module")
def server(folder: Path) -> Iterator[Served]:
    with serving(folder) as served:
        yield served
    for journal in folder.glob("runs/run-*/journal.sqlite"):
        if process := process_of(journal.parent):
            end(process)


@pytest.fixture
def window(server: Served) -> Iterator[Window]:
    with browsing() as browser:
        browser.resize(1280, 800)
        yield Window(browser)


def state(folder: Path) -> str:
    runs = Worker().runs(str(folder / "runs"))["runs"]
    return str(runs[-1]["state"]) if runs else ""


def process_of(run: Path) -> int | None:
    process = Worker().run(str(run))["process"]
    return None if process is None else int(process)


def files(folder: Path) -> dict[str, dict[str, object]]:
    return dict(json.loads((folder / "app.json").read_text("utf-8"))["files"])


def test_from_files_to_a_fit_that_outlives_its_server(folder: Path, server: Served, window: Window) -> None:
    bench = write_bench(folder.parent / "bench")
    hostile = folder.parent / "bench" / '..\\..\\<b onload="alert(1)">x.csv'
    hostile.write_text("no numbers\nat all\n")
    window.browser.open(server.address)
    window.drop("Drop data files here, or press +", *bench, _CASE, hostile)
    window.wait("document.querySelectorAll('.file').length == 4")
    window.wait("document.querySelector('.file [role=alert]')")
    wait_until(lambda: len(files(folder)) == 4 and all("facts" in e for e in files(folder).values()), "all are read")
    unread = [name for name, entry in files(folder).items() if entry["reason"]]
    assert len(unread) == 1
    assert not set('<>"\\') & set(unread[0])
    window.press("", f'[aria-label="Remove {unread[0]}"]')
    window.wait("document.querySelectorAll('.file').length == 3")
    window.fill("Back pressure behind the nozzle", "0.5 MPa")
    window.fill("Pressure at the end of the return line", "0.1 MPa")
    wait_until(lambda: "0.1 MPa" in (folder / "app.json").read_text(), "the pressure is saved")

    window.press("2 Injector")
    window.choose("Type", "cri2-16:")
    window.wait("document.querySelector('svg.section')")
    window.press("nozzle holes", ".q-expansion-item .q-item")
    window.fill("diameter of a nozzle hole", "0.131 mm")
    wait_until(lambda: "0.131 mm" in (folder / "injector.toml").read_text(), "the dimension is written")
    window.press("Prepare the study")
    window.read("Before any fit")
    written = tomllib.loads((folder / "study-1/study.toml").read_text())["optimiser"]
    assert EFFORTS["normal"].items() >= {key: value for key, value in written.items() if key != "method"}.items()
    window.wait("document.querySelectorAll('.tile svg').length >= 5")  # two maps of two charts, and a curve
    window.wait("document.querySelector('[aria-label^=\"Time zero\"]')")

    window.press("3 Calibrate")
    window.choose("Free only", "the best 2")
    window.wait("document.querySelectorAll('.parameter').length <= 3")
    window.press("quick")
    wait_until(lambda: "members = 60" in (folder / "study-1/study.toml").read_text(), "the effort is written")
    window.press("Start")
    wait_until(lambda: state(folder) == "running", "the fit runs")
    assert not window.browser.complaints


def test_another_server_and_another_window_find_the_run(folder: Path, server: Served) -> None:
    process = process_of(folder / "runs/run-1")
    server.process.kill()
    server.process.wait()
    with serving(folder) as again, browsing() as one, browsing() as other:
        for browser in (one, other):
            browser.open(f"{again.address}&step=Calibrate")
            Window(browser).read("run-1 ·")
        assert process is None or is_alive(process) or state(folder) == "finished"
        wait_until(lambda: (time.sleep(0.5), state(folder))[1] != "running", "the fit ends")
        assert state(folder) == "finished"
        for browser in (one, other):
            Window(browser).read("run-1 · finished")
            Window(browser).wait("document.querySelectorAll('.tile').length >= 6")  # before and after
        take_away(folder, again, Window(one))
        stop_and_continue(folder, Window(other))


def take_away(folder: Path, server: Served, window: Window) -> None:
    window.browser.call("Page.setDownloadBehavior", behavior="allow", downloadPath=str(folder.parent / "taken"))
    window.press("4 Result")
    window.wait("document.querySelector('iframe.report')")
    for words, name in (("Study", "study.toml"), ("Commands", "commands.sh"), ("DCM", "run-1.dcm")):
        window.press(words, ".buttons button")
        wait_until((folder.parent / "taken" / name).is_file, f"{name} is saved")
    assert (
        "FESTSTUETZSTELLENVERTEILUNG" in (out := (folder / "out/run-1.dcm").read_text("latin-1")) or "KENNFELD" in out
    )
    commands = (folder / "commands.sh").read_text()
    assert [line.split()[1] for line in commands.splitlines()] == ["new", "calibrate", "map"]


def stop_and_continue(folder: Path, window: Window) -> None:
    window.press("thorough")
    window.press("Start")
    window.wait("/run-2 · running · step [0-9]+ of [0-9]+ · J/.test(document.body.innerText)")
    window.press("Stop", "button")
    wait_until(lambda: (time.sleep(0.5), state(folder))[1] == "interrupted", "the fit has stopped")
    window.read("run-2 · interrupted")


def test_a_workshop_judges_a_part_in_german(folder: Path, window: Window) -> None:
    with serving(folder) as served:
        window.browser.open(served.address)
        window.browser.open(f"http://127.0.0.1:{served.port}/workshop?language=de")
        window.drop("Prüfplan hier ablegen", _PLAN)
        window.wait("[...document.querySelectorAll('input')].some((e) => e.value == '65.5')")
        window.fill("Teilenummer oder Typ", "0 445 110 191")
        window.press("Beurteilen")
        window.wait("document.querySelector('.verdict.fail')")
        window.read("NICHT BESTANDEN")
        window.read("ausgespülte Düse")
        assert window.sees("document.querySelectorAll('.bandbar').length == 7")
        window.browser.resize(390, 800, phone=True)
        window.wait("document.documentElement.scrollWidth <= 390")
        assert not window.browser.complaints
