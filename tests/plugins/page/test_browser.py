"""The page in a real browser: its simulations against the engine's, its sliders, its address and its files.

All that the page shows is read from the page; nothing here measures time (``python -m benchmarks.page_speed`` does).
"""

from __future__ import annotations

import csv
import importlib.util
import io
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import commonrail as cr
from commonrail.data.curves.data import RateData
from commonrail.data.simulator import Simulator
from commonrail.plugins.page.page import page_html
from commonrail.plugins.page.subject import Slider, Subject, read_subject
from commonrail.runs.folder import read_fit
from tools.browser import CHROMIUM, Browser, browsing

ROUNDING = 1e-9  # of a channel's peak
DRIBBLE = 1e-6  # share that a needle at rest lets through: the page ends its simulation before the engine
LARGEST = 1_000_000  # [bytes]
HOSTILE = "</script><img src=x onerror=console.error('broken out')>&quot;"
KEYS = {"ArrowRight": 39, "ArrowLeft": 37, "Home": 36}

pytestmark = [
    pytest.mark.process,
    pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium on this machine"),
    pytest.mark.skipif(importlib.util.find_spec("websocket") is None, reason="websocket-client is not installed"),
    pytest.mark.skipif(importlib.util.find_spec("ziglang") is None, reason="ziglang is not installed"),
]


@pytest.fixture(scope="module")
def subject(run_folder: Path) -> Subject:
    return replace(read_subject(str(run_folder)), title=HOSTILE)


@pytest.fixture(scope="module")
def file(subject: Subject, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "bench.html"
    path.write_text(page_html(subject), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with browsing() as found:
        yield found


@pytest.fixture
def page(browser: Browser, file: Path) -> Iterator[Browser]:
    """The page as it opens; it must not have complained by the end of a test."""
    browser.complaints.clear()
    browser.resize(1280, 900)
    opened(browser, file)
    yield browser
    assert browser.complaints == []


def opened(browser: Browser, file: Path, address: str = "") -> None:
    browser.open(file.as_uri() + address)
    settled(browser)


def settled(browser: Browser) -> None:
    """Wait until what is drawn is what the page's state asks for."""
    browser.until("window.commonrail && commonrail.settled()")


def act(browser: Browser, script: str) -> None:
    """Change something in the page, and wait until it is drawn."""
    browser.evaluate(f"(() => {{ {script}; }})()")
    settled(browser)


def slide(browser: Browser, slider: str, value: float) -> None:
    """Move a slider to a value in the unit that it shows."""
    act(
        browser,
        f"const s = document.getElementById({slider!r}); s.step = 'any'; s.value = {value!r}; "
        "s.dispatchEvent(new Event('input'))",
    )


def shown(browser: Browser) -> dict[str, Any]:
    """Course that the page draws: time step, point, channels by name, mass injected after every step."""
    return dict(
        browser.evaluate("""(() => {
            const { state, course } = commonrail.shown(), width = commonrail.model.channels.length;
            const column = (i) => Array.from({ length: course.rows + 1 }, (_, k) => course.channels[k * width + i]);
            return { point: state.point, every: course.every, injected: Array.from(course.injected),
              status: course.status, figures: course.figures,
              channels: Object.fromEntries(commonrail.model.channels.map((name, i) => [name, column(i)])) };
          })()""")
    )


def check_against_engine(found: dict[str, Any], injector: cr.Injector, rail: cr.Trace | None = None) -> None:
    """Compare a course of the page with the lanes at the same point."""
    p = found["point"]
    pulses = [tuple(pulse) for pulse in p["pulses"]]
    point = cr.OperatingPoint(
        rail or p["rail"], pulses, p["cylinder"], p["low"], horizon=p["duration"], start=p["start"]
    )
    solution = cr.simulate(injector, point)
    assert found["status"] == "ok"
    injected = np.array(found["injected"])
    assert np.max(np.abs(injected - solution.injected[: len(injected)])) <= ROUNDING * solution.injected_mass
    assert injected[-1] == pytest.approx(solution.injected_mass, rel=DRIBBLE)
    compared = set(found["channels"]) & set(solution.channels)
    assert {"needle_lift", "valve_lift", "accumulation_pressure", "coil_current"} <= compared
    for name in compared - ({"rail_pressure"} if rail else set()):
        own, engine = (
            np.array(found["channels"][name]),
            solution.channels[name][:: found["every"]][: len(found["channels"][name])],
        )
        assert np.max(np.abs(own - engine)) <= ROUNDING * np.max(np.abs(engine)), name
    instants = [p["start"] + 1e-6 * found["figures"][name] for name in ("opening", "closing")]
    assert instants == pytest.approx([solution.opening, solution.closing], rel=ROUNDING)


def test_the_page_is_one_small_file_that_loads_nothing(file: Path) -> None:
    text = file.read_text(encoding="utf-8")
    assert len(text.encode()) < LARGEST
    assert "http://" not in text.replace("http://www.w3.org", "")
    assert "https://" not in text


def test_it_opens_with_the_fit_and_its_measured_rail_pressure(page: Browser, subject: Subject) -> None:
    assert page.evaluate("document.title").startswith("</script>")
    assert page.evaluate("document.images.length") == 0
    (first, *_) = subject.data
    assert isinstance(first.point.rail_pressure, cr.Trace)
    check_against_engine(shown(page), subject.injector, first.point.rail_pressure)


def test_j_of_every_curve_is_that_of_the_engine(page: Browser, subject: Subject) -> None:
    def scores(injector: cr.Injector) -> list[float]:
        return [d.score(Simulator(injector, (), subject.time_step)).j for d in subject.data]

    assert page.evaluate("commonrail.scores().j") == pytest.approx(scores(subject.injector), rel=ROUNDING)
    slide(page, "plunger_needle.k1", 150.0)
    moved = subject.injector.with_values({"plunger_needle.k1": 150e6})
    found = page.evaluate("commonrail.scores().j")
    assert found == pytest.approx(scores(moved), rel=ROUNDING)
    table = page.evaluate("[...document.querySelectorAll('#scores tbody tr')].map((r) => +r.cells[2].textContent)")
    assert table == pytest.approx(found, abs=0.006)


def test_a_slider_moved_by_the_keyboard_moves_the_injection(page: Browser, subject: Subject) -> None:
    page.evaluate("document.getElementById('rail').focus()")
    for _ in range(3):
        page.press("ArrowLeft", "ArrowLeft", KEYS["ArrowLeft"])
    settled(page)
    found = shown(page)
    assert found["point"]["rail"] < 160e6  # the measured pressure is replaced
    check_against_engine(found, subject.injector)


def test_two_injections_with_a_dwell_are_those_of_the_engine(page: Browser, subject: Subject) -> None:
    act(page, "const c = document.getElementById('count'); c.value = '2'; c.dispatchEvent(new Event('change'))")
    slide(page, "rail", 120.0)
    slide(page, "energising-1", 250.0)
    slide(page, "dwell-2", 333.3)
    slide(page, "cylinder", 8.0)
    found = shown(page)
    assert np.diff(np.array(found["point"]["pulses"])[:, 0]) == pytest.approx([583.3e-6], rel=1e-9)
    check_against_engine(found, subject.injector)


def test_the_fuel_temperature_is_that_of_the_engine(page: Browser, subject: Subject) -> None:
    slide(page, "rail", 120.0)
    slide(page, "temperature", 50.0)
    kelvin = page.evaluate("commonrail.model.temperature.nodes[commonrail.state().temperature]")
    assert kelvin == pytest.approx(323.15, abs=0.5)
    check_against_engine(shown(page), subject.injector.with_values({"fuel.temperature": kelvin}))


def test_a_free_parameter_and_a_preset_are_those_of_the_engine(page: Browser, subject: Subject) -> None:
    act(page, "const c = document.getElementById('preset'); c.value = '1'; c.dispatchEvent(new Event('change'))")
    (first, *_) = subject.data
    assert isinstance(first.point.rail_pressure, cr.Trace)
    check_against_engine(shown(page), subject.injector.with_values(subject.start), first.point.rail_pressure)
    page.press("r", "KeyR", 82)
    settled(page)
    check_against_engine(shown(page), subject.injector, first.point.rail_pressure)


def test_the_fan_shows_its_members(page: Browser, subject: Subject, run_folder: Path) -> None:
    page.press("f", "KeyF", 70)
    settled(page)
    masses = page.evaluate("commonrail.fan().masses.map((m) => m[m.length - 1])")
    assert page.evaluate("commonrail.fan().drawn") is True
    drawn = page.evaluate(
        "[...document.querySelectorAll('#rate svg.wide .pane [data-key=fan]')].map((p) => p._points.length)"
    )
    assert len(drawn) >= len(masses)
    assert sorted(drawn)[-len(masses)] > 100  # points of each curve; the entry of the legend has none
    assert subject.fan is not None
    assert len(masses) == len(subject.fan.members)
    (first, *_) = subject.data
    for mass, member in zip(masses[:3], subject.fan.members, strict=False):
        injector = subject.injector.with_values(dict(zip(subject.fan.names, member.tolist(), strict=True)))
        point = replace(first.point, horizon=page.evaluate("commonrail.shown().state.point.duration"))
        assert mass == pytest.approx(cr.simulate(injector, point).injected_mass, rel=DRIBBLE)  # up to a whole sample
    assert "5%" in page.evaluate("document.getElementById('fan-note').textContent")


def test_the_map_is_that_of_the_engine(page: Browser, subject: Subject) -> None:
    page.until("commonrail.map() !== null")
    found = page.evaluate("commonrail.map()")
    for i, k in ((0, 11), (2, 5), (4, 3)):
        rail, time = found["pressures"][i], found["times"][k]
        at = cr.OperatingPoint(rail, time, 5e6, 0.5e6, horizon=time + 2.5e-3)
        assert found["quantity"][i][k] == pytest.approx(cr.simulate(subject.injector, at).injected_mass, rel=DRIBBLE)


def test_measured_maps_are_those_of_the_engine(run_folder: Path, browser: Browser, tmp_path: Path) -> None:
    """Quantities and a dead time that is judged as one, at pressures of their own; the page opens at one of them."""
    subject = replace(read_subject(str(run_folder)), data=(), fan=None)
    pressures = [(140e6, 0.6e6, 0.1e6)] * 4 + [(75e6, 0.6e6, 0.1e6)] * 2
    times = (260e-6, 500e-6, 900e-6, 300e-6, 600e-6, 800e-6)
    points = tuple(cr.OperatingPoint(p, t, c, r) for (p, c, r), t in zip(pressures, times, strict=True))
    quantity = np.array([4.0, 20.0, 60.0, 0.5, 12.0, 30.0]) * 1e-9
    meter = cr.Meter("balance", {"gain": 1.02, "quantity_offset": "0.1 mm3"})
    dead = np.array([False, False, False, True, False, False])
    data = cr.QuantityData(
        "map", cr.data.Role.FIT, points, quantity, 1e-10, 0.02, dead, 1.0, "", "", math.nan, 5e-6, meter=meter
    )
    subject = replace(subject, maps=(data,))
    (tmp_path / "map.html").write_text(page_html(subject), encoding="utf-8")
    browser.complaints.clear()
    opened(browser, tmp_path / "map.html")
    values = data.simulated(Simulator(subject.injector, (), subject.time_step), np.empty((1, 0)))[0]
    (found,) = browser.evaluate("commonrail.scores().maps")
    assert found["values"] == pytest.approx(values.tolist(), rel=DRIBBLE)
    assert found["j"] == pytest.approx(float(data.misfit(values)), rel=1e-4)  # errors of tolerances amplify the dribble
    p = shown(browser)["point"]  # nearest to 100 MPa and 700 µs, with its other pressures
    assert (p["rail"], p["cylinder"], p["low"], p["pulses"][0][1]) == (75e6, 0.6e6, 0.1e6, 800e-6)
    browser.until("commonrail.map() !== null")
    assert browser.evaluate("commonrail.map().pressures") == [75e6, 140e6]
    text = browser.evaluate("document.body.innerText")
    assert "measured, mm³" in text
    assert f"{data.misfit(values):.2f}" in text
    slide(browser, "plunger_needle.k7", 80.0)
    assert browser.evaluate("commonrail.scores().maps[0].j") != pytest.approx(found["j"], rel=1e-3)
    assert browser.complaints == []


def test_the_address_holds_the_state(page: Browser, file: Path) -> None:
    slide(page, "rail", 95.5)
    slide(page, "energising-1", 612.5)
    slide(page, "plunger_needle.k6", 201.25)
    slide(page, "temperature", 65.0)
    address, before = page.evaluate("commonrail.address()"), shown(page)
    opened(page, file, f"#{address}")
    assert shown(page) == before
    assert page.evaluate("document.getElementById('rail').valueAsNumber") == pytest.approx(95.5, abs=0.2)


@pytest.mark.parametrize(
    "address", ["#rail=abc&pulses=1&data=99&temperature=-5", "#rail=1e99&pulses=0%2B-1", "#%E0%A4"]
)
def test_a_damaged_address_opens_what_can_be_read(page: Browser, file: Path, address: str) -> None:
    before = shown(page)
    opened(page, file, address)
    assert shown(page)["status"] == "ok"
    assert shown(page)["point"]["rail"] == before["point"]["rail"]


def test_the_toml_is_the_injector_of_the_sliders(page: Browser, subject: Subject, tmp_path: Path) -> None:
    slide(page, "plunger_needle.k1", 150.0)
    slide(page, "temperature", 60.0)
    (tmp_path / "taken.toml").write_text(page.evaluate("commonrail.toml()"), encoding="utf-8")
    injector = cr.load_injector(tmp_path / "taken.toml")
    kelvin = page.evaluate("commonrail.model.temperature.nodes[commonrail.state().temperature]")
    moved = {"plunger_needle.k1": 150e6, "fuel.temperature": kelvin}
    assert injector.values == pytest.approx({**subject.injector.values, **moved}, rel=1e-15)
    assert injector.sources["plunger_needle.k1"] == cr.models.Source("E", "set on a bench page")
    assert injector.sources["plunger_needle.k2"] == cr.load_injector("virtual-lino-2016").sources["plunger_needle.k2"]


def test_the_csv_holds_the_curves(page: Browser) -> None:
    text = page.evaluate("commonrail.csv()")
    rows = list(csv.reader(io.StringIO("".join(line for line in text.splitlines(True) if not line.startswith("#")))))
    found = shown(page)
    assert rows[0] == ["time", "rate", *found["channels"]]
    table = np.array(rows[1:], float)
    assert table[:, 2 + list(found["channels"]).index("needle_lift")].tolist() == found["channels"]["needle_lift"]
    density = page.evaluate("commonrail.shown().state.density")
    volume = np.sum(table[:, 1]) * 1e-6 * found["every"] * 1e-6
    assert volume * density == pytest.approx(found["injected"][found["every"] * (len(table) - 1)], rel=1e-9)


def test_a_failed_simulation_is_a_sentence(page: Browser) -> None:
    act(page, "commonrail.take({ ...commonrail.state(), values: { 'plunger_needle.k1': 1e12 } })")
    assert "the range" in page.evaluate("document.getElementById('status').textContent")
    assert page.evaluate("document.querySelector('#figures dd').textContent") == "–"


def test_the_order_of_the_run_stops_a_slider(page: Browser, subject: Subject) -> None:
    upper = subject.injector.values["plunger_needle.k3"]
    slide(page, "plunger_needle.k2", 200.0)  # in the order of the paper k2 lies between k7 and k3
    values = page.evaluate("commonrail.state().values")
    assert 0.999 * upper < values["plunger_needle.k2"] < upper
    assert "run's constraint" in page.evaluate("document.getElementById('status').textContent")
    assert subject.space is not None
    moved = subject.injector.with_values(values).values
    assert subject.space.satisfies([moved[name] for name in subject.space.names])
    measured = subject.data[0].point.rail_pressure
    assert isinstance(measured, cr.Trace)
    check_against_engine(shown(page), subject.injector.with_values(values), measured)
    slide(page, "plunger_needle.k3", 82.0)  # now below k2: stopped from the other side
    assert page.evaluate("commonrail.state().values")["plunger_needle.k3"] > values["plunger_needle.k2"]
    slide(page, "rail", 120.0)
    assert "stopped" not in page.evaluate("document.getElementById('status').textContent")


def test_a_slow_simulation_waits_for_the_next_frame(page: Browser, subject: Subject) -> None:
    slide(page, "rail", 120.0)
    page.evaluate("lasted = LONG")  # as if the last one had taken so long
    act(
        page,
        "for (const mpa of [100, 110, 130]) { const s = document.getElementById('rail'); s.step = 'any'; "
        "s.value = mpa; s.dispatchEvent(new Event('input')); }",
    )
    found = shown(page)
    assert found["point"]["rail"] == pytest.approx(130e6)  # the newest state
    check_against_engine(found, subject.injector)


@pytest.mark.parametrize(("width", "phone"), [(1280, False), (390, True)])
def test_nothing_is_wider_than_the_window(page: Browser, file: Path, width: int, phone: bool) -> None:
    page.resize(width, 844, phone)
    opened(page, file)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert page.evaluate("[...document.querySelectorAll('input, select')].every((e) => e.labels.length || e.ariaLabel)")


@pytest.mark.parametrize(("width", "phone"), [(1280, False), (390, True)])
def test_the_longest_values_and_units_of_sliders_are_not_cut(page: Browser, width: int, phone: bool) -> None:
    """Values of five digits, as `nozzle.shape_1` and `nozzle.discharge_growth` have, and a unit of six letters."""
    page.resize(width, 844, phone)
    cut = page.evaluate("""((texts) => {
        const slider = document.querySelector('.slider');
        const value = slider.querySelector('input[type=number]'), unit = slider.querySelector('.unit');
        const isCut = (e) => e.scrollWidth > e.clientWidth;
        value.step = 'any'; value.removeAttribute('min');
        unit.textContent = '\u00b5m/MPa';
        return texts.filter((t) => { value.value = t; return value.value !== t || isCut(value) || isCut(unit); });
    })(['-0.050102', '2.3726e-10'])""")
    assert cut == []


def test_measured_curves_of_another_point_are_marked(page: Browser) -> None:
    legend = "document.querySelector('#rate svg.wide').textContent"
    assert "another operating" not in page.evaluate(legend)
    slide(page, "rail", 84.0)
    assert "another operating" in page.evaluate(legend)


def test_parameters_stand_by_component_and_effect_and_are_filtered(browser: Browser, tmp_path: Path) -> None:
    """Of an injector without a run the page finds the effects itself."""
    subject = read_subject("virtual-lino-2016", ("nozzle.hole_diameter", "nozzle.discharge_maximum", "valve.lift"))
    (tmp_path / "page.html").write_text(page_html(subject), encoding="utf-8")
    browser.complaints.clear()
    opened(browser, tmp_path / "page.html")
    groups = browser.evaluate("[...document.querySelectorAll('#parameter-sliders section')].map((g) => g.dataset.part)")
    assert len(groups) == len(set(groups)) == len({s.name.partition(".")[0] for s in subject.sliders})
    effects = browser.evaluate("Object.fromEntries(commonrail.model.sliders.map((p) => [p.name, p.effect]))")
    order = browser.evaluate("[...document.querySelectorAll('#parameter-sliders input[type=range]')].map((r) => r.id)")
    for group in {name.partition(".")[0] for name in order}:
        own = [effects[name] for name in order if name.partition(".")[0] == group]
        assert own == sorted(own, reverse=True)
    assert effects[order[0]] == max(effects.values()) > 0.0
    act(browser, "const f = document.getElementById('filter'); f.value = 'VALVE'; f.dispatchEvent(new Event('input'))")
    seen = browser.evaluate(
        "[...document.querySelectorAll('#parameter-sliders .slider')].filter((s) => s.offsetHeight).map((s) => "
        "s.querySelector('input').id)"
    )
    assert seen == [name for name in order if "valve" in name]
    assert browser.complaints == []


def test_the_status_line_moves_no_chart(page: Browser) -> None:
    top = "document.getElementById('rate').getBoundingClientRect().top"
    before = page.evaluate(top)
    slide(page, "plunger_needle.k2", 200.0)
    assert "stopped" in page.evaluate("document.getElementById('status').textContent")
    assert page.evaluate(top) == before


def test_one_cursor_crosses_all_charts_over_time(page: Browser) -> None:
    page.evaluate(
        "(() => { const panel = document.querySelector('#rate svg.wide .panel'), box = panel.querySelector('rect')"
        ".getBoundingClientRect(); panel.dispatchEvent(new PointerEvent('pointermove', { bubbles: true, "
        "pointerType: 'mouse', clientX: box.left + 0.4 * box.width, clientY: box.top + 9 })); })()"
    )
    page.evaluate("window.scrollTo(0, 300)")
    told = page.evaluate("document.querySelector('.readout').textContent")
    assert "simulated" in told
    marked = page.evaluate("charts.list.filter((c) => c.svg.querySelector('.reader[d^=M]')).map((c) => c.title)")
    assert set(marked) == {"time, µs"}


def test_the_section_moves_with_the_cursor_as_the_simulation_does(page: Browser) -> None:
    page.evaluate("document.dispatchEvent(new CustomEvent('reader', { detail: { title: 'time, µs', x: 600 } }))")
    assert page.evaluate("document.querySelector('#anatomy output').textContent") == "600 µs"
    found = shown(page)
    at = round(600e-6 / (found["every"] * page.evaluate("commonrail.model.dt")))
    for name, scale in (("needle_lift", 1e6), ("control_pressure", 1e-6)):
        said = page.evaluate(f"document.querySelector('#anatomy [data-say={name}]').textContent")
        assert float(said.split()[0]) == round(scale * found["channels"][name][at])
    needle = "document.querySelector('#anatomy [data-move=needle_lift]').getAttribute('transform')"
    before = page.evaluate(needle)
    page.evaluate("document.dispatchEvent(new CustomEvent('reader', { detail: { title: 'time, µs', x: 0 } }))")
    assert page.evaluate(needle) != before


def test_dark_and_light(page: Browser) -> None:
    paper = "getComputedStyle(document.body).backgroundColor"
    light = page.evaluate(paper)
    page.press("d", "KeyD", 68)
    assert page.evaluate(paper) != light
    page.press("d", "KeyD", 68)
    assert page.evaluate(paper) == light


METERS = {
    "causal": cr.Meter("bench", {"delay": "5 us", "cutoff": "8 kHz", "gain": 1.02, "offset": "0.01 mm3/ms"}),
    "cascade": cr.Meter("bench", {"cutoff": "6 kHz", "delay": "-7.3 us"}, "cascade", 3),
    "all": cr.Meter(
        "bench",
        {
            **{"delay": "12.5 us", "cutoff": "9 kHz", "late_cutoff": "3 kHz", "blend": "230 us", "zeroing": 0.02},
            **{"echo_share": 0.1, "echo_delay": "300 us", "echo_lag": "200 us", "density": "830 kg/m3"},
            **{"second_echo_share": 0.05, "second_echo_delay": "500.4 us"},
        },
        "zero-phase",
        4,
    ),
}


def test_curves_are_compared_as_their_meters_show_them(run_folder: Path, browser: Browser, tmp_path: Path) -> None:
    study, _ = read_fit(run_folder)
    first = study.data[0]
    assert isinstance(first, RateData)
    curves = tuple(replace(first, name=name, meter=meter) for name, meter in METERS.items())
    subject = replace(read_subject(str(run_folder)), data=curves, fan=None)
    (tmp_path / "metered.html").write_text(page_html(subject), encoding="utf-8")
    browser.complaints.clear()
    opened(browser, tmp_path / "metered.html")
    scores = [d.score(Simulator(subject.injector, (), subject.time_step)) for d in curves]
    assert browser.evaluate("commonrail.scores().j") == pytest.approx([score.j for score in scores], rel=1e-9)
    shown_rate = np.array(browser.evaluate("Array.from(commonrail.scores().rate)"))
    assert np.max(np.abs(shown_rate - scores[0].values)) <= ROUNDING * np.max(scores[0].values)
    assert "as bench" in browser.evaluate("document.getElementById('rate').textContent")
    assert browser.complaints == []


@pytest.mark.slow  # one more wiring to compile
def test_an_injector_that_follows_a_current_is_that_of_the_engine(browser: Browser, tmp_path: Path) -> None:
    time = np.linspace(0.0, 2e-3, 401)
    course = cr.Trace.of(time, np.where(time < 600e-6, 20.0 * np.minimum(time / 80e-6, 1.0), 0.0))
    injector = replace(cr.load_injector("virtual-lino-2016"), variant=cr.Variant(drive="current trace"))
    point = cr.OperatingPoint("120 MPa", [], drive=course, horizon="1.8 ms")
    bounds = np.linspace(0.0, 1.8e-3, 181)
    solution = cr.simulate(injector, point)
    rate = np.diff(np.interp(bounds, solution.time, solution.injected)) / np.diff(bounds) / solution.reference_density
    data = cr.RateData("traced", cr.data.Role.FIT, point, bounds, rate, 1.0, "simulated", "simulated, not measured")
    slider = Slider("valve.spring_preload", 60.0, 80.0)
    subject = Subject("traced", injector, (slider,), 1e-6, {}, (data,), (), None)
    (tmp_path / "traced.html").write_text(page_html(subject), encoding="utf-8")
    browser.complaints.clear()
    opened(browser, tmp_path / "traced.html")
    found = shown(browser)
    assert np.max(np.abs(np.array(found["injected"]) - solution.injected[: len(found["injected"])])) <= (
        ROUNDING * solution.injected_mass
    )
    assert solution.injected_mass > 1e-5
    assert browser.evaluate("commonrail.scores().j[0]") < 1e-6
    assert browser.evaluate("document.getElementById('energising-1')") is None
    slide(browser, "valve.spring_preload", 75.0)
    assert browser.evaluate("commonrail.scores().j[0]") > 1.0
    assert browser.complaints == []
