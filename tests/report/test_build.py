"""The report of a run folder: complete, self-contained, safe to open."""

from __future__ import annotations

import errno
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from commonrail.base.errors import InputError, OutputError
from commonrail.calibration.optimisers.registry import registered
from commonrail.calibration.optimisers.staged import StagedSettings
from commonrail.plugins.multistart import MultiStartSettings
from commonrail.report.page import report_html, write_report
from tests.refused import refused
from tests.report.conftest import WriteRun
from tests.report.samples import SYNTHETIC, map_record, rate_record, rate_traces


class Page(HTMLParser):
    """Elements and visible text of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self._hidden = False
        self.feed(text)
        self.text = " ".join(self.text.split())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        self._hidden = tag in ("script", "style")

    def handle_endtag(self, tag: str) -> None:
        self._hidden = False

    def handle_data(self, data: str) -> None:
        if not self._hidden:
            self.text += data

    def count(self, tag: str, **attributes: str) -> int:
        """Number of elements of a tag with these attributes."""
        return sum(t == tag and attributes.items() <= a.items() for t, a in self.tags)


def page_of(folder: Path) -> Page:
    """Page that the report of a run folder is."""
    return Page(write_report(folder).read_text(encoding="utf-8"))


def test_curves_convergence_and_parameters_are_there(rate_run: Path) -> None:
    page = page_of(rate_run)
    assert page.count("div", **{"class": "drawing"}) == 6  # three curves, volumes, autocorrelation, convergence
    assert page.text.count("stiffness of cylinder") == 14  # on the first screen, and in the table
    for words in ("Error J of the injection curves", "931.4", "402.2", "171.5", "only in combination"):
        assert words in page.text


def test_maps_errors_dead_times_and_convergence_are_there(map_run: Path) -> None:
    page = page_of(map_run)
    # one for each map, dead times of one, two heat maps of the first, all quantities, convergence
    assert page.count("div", **{"class": "drawing"}) == 7
    for words in ("148.31", "Dead times, µs: map (fit)", "Quantities, mm³: map at 80 MPa"):
        assert words in page.text


def test_how_it_came_about_is_there(rate_run: Path) -> None:
    text = page_of(rate_run).text
    for words in ("3,550 candidates proposed; 3,211 simulated; 4 failed", "numba 0.60.0"):
        assert words in text
    assert "/study.toml" in text
    assert "plunger_needle.k7 < plunger_needle.k2" in text  # the constraint


OPTIMISER = {"method": "differential evolution", "members": 24, "generations": 30, "initial": "reference", "polish": 2}


def test_the_search_and_where_it_started_are_said(write_run: WriteRun) -> None:
    text = page_of(write_run(map_record() | {"optimiser": OPTIMISER})).text
    assert re.search(r"30 generations of 24 members; .*start values", text)
    assert "; 2 least-squares" in text


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (MultiStartSettings(), "8 starts of 128 draws, 60 iterations"),
        (StagedSettings(), "400 screened candidates, 52 steps"),
    ],
)
def test_each_search_is_told_in_its_own_words(write_run: WriteRun, settings: Any, words: str) -> None:
    entry = registered(settings)
    assert entry is not None
    record = {"method": entry.name, **vars(settings), "polish": 0}
    assert words in page_of(write_run(map_record() | {"optimiser": record})).text


def test_synthetic_data_are_announced(rate_run: Path) -> None:
    page = page_of(rate_run)
    assert page.text.index("synthetic data,") < page.text.index("unseen")  # above the figures
    assert SYNTHETIC in page.text
    assert "EVI 160 MPa, EVI 120 MPa and EVI 80 MPa" in page.text


def test_one_synthetic_set_among_measured_ones_is_announced(write_run: WriteRun) -> None:
    record = map_record()
    record["data"][1]["synthetic"] = "Interpolated."
    text = page_of(write_run(record)).text
    assert "synthetic data," in text
    assert "map at 80 MPa is synthetic" in text
    assert "Interpolated." in text


def test_measured_data_have_no_banner(map_run: Path) -> None:
    assert page_of(map_run).count("div", **{"class": "banner"}) == 0
    assert "synthetic data," not in page_of(map_run).text


def test_a_search_that_was_stopped_is_announced(write_run: WriteRun) -> None:
    page = page_of(write_run(map_record() | {"status": "interrupted"}))
    assert page.count("div", **{"class": "banner"}) == 1
    assert "Stopped early" in page.text


def test_warnings_stand_on_top_of_the_page(write_run: WriteRun) -> None:
    sentence = "EVI 160 MPa: the data come 35 us later than the simulation."
    warning = {"code": "shift", "subject": "EVI 160 MPa", "sentence": sentence}
    page = page_of(write_run(map_record() | {"warnings": [warning]}))
    assert page.count("div", **{"class": "banner warning"}) == 1
    assert page.text.index("Implausible") < page.text.index(sentence) < page.text.index("fitted to")


def test_the_title_of_the_window_tells_an_implausible_fit_from_another() -> None:
    titles = set()
    for warnings in ([], [{"code": "shift", "subject": "map", "sentence": "The data come late."}]):
        record = map_record() | {"warnings": warnings, "title": "Part 17"}
        titles |= set(re.findall("<title>(.*Part 17.*)</title>", report_html(record, {})))
    assert len(titles) == 2


def test_nothing_is_loaded_from_anywhere(rate_run: Path) -> None:
    text = write_report(rate_run).read_text(encoding="utf-8")
    page = Page(text)
    sources = {"src", "href", "data", "action", "poster", "srcset"}
    assert [a for _, a in page.tags if sources & a.keys() and not (a.get("href") or "").startswith("#")] == []
    own = text.replace("http://www.w3.org/2000/svg", "")  # the name of a kind of element, which nothing loads
    assert re.findall(r"https?://|@import|url\(", own) == []
    policy = next(a["content"] for t, a in page.tags if t == "meta" and "http-equiv" in a)
    assert policy is not None
    assert policy.startswith("default-src 'none'")
    assert "http" not in policy


def test_a_report_is_small_enough_to_be_mailed(rate_run: Path) -> None:
    assert len(write_report(rate_run).read_bytes()) < 200_000  # the curves are 3 × 520 samples


def test_a_failed_start_still_has_a_report(write_run: WriteRun) -> None:
    record = rate_record()
    record["objective"]["start"] = None
    for d in record["data"]:
        for key in ("J", "J_relative", "volume"):
            d[key] |= {"start": None, "rigid": None}
    text = page_of(write_run(record, rate_traces(record))).text
    assert "values fail" in text


def test_without_generations_there_is_no_convergence(write_run: WriteRun) -> None:
    record = map_record() | {"generations": [], "parameters": []}
    assert page_of(write_run(record)).count("div", **{"class": "drawing"}) == 6


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"kind": "other"}, "result of commonrail calibrate"),
        ({"schema": 2}, "another version"),
        ({"injector": {}}, r"result\.json: injector\.name: this key is missing; calibrate again\."),
        ({"data": [{"kind": "rate", "role": "fit"}]}, "is incomplete"),
        ({"data": []}, r"is incomplete \(IndexError"),
        ({"labels": []}, r"labels: an object was expected, and \[\] was read; calibrate again\."),
        ({"labels": {"start": "start values"}}, "is incomplete"),  # the calibrated one is missing
        ({"seconds": {}, "software": []}, "software: an object was expected"),
    ],
)
def test_a_result_that_cannot_be_read_says_why(write_run: WriteRun, change: dict[str, Any], words: str) -> None:
    folder = write_run(rate_record() | change)
    with pytest.raises(InputError, match=words) as caught:
        write_report(folder)
    assert str(folder) in str(caught.value)


def test_a_missing_key_is_named(write_run: WriteRun) -> None:
    record = map_record()
    del record["seed"]
    with pytest.raises(InputError, match='lacks "seed"'):
        write_report(write_run(record))


def test_a_curve_without_its_trace_is_refused(write_run: WriteRun) -> None:
    with pytest.raises(InputError, match=r"incomplete .*EVI 160 MPa"):
        write_report(write_run(rate_record()))


def test_a_text_that_is_missing_in_a_data_set_is_a_sentence(write_run: WriteRun) -> None:
    record = map_record()
    del record["data"][0]["source"]
    with pytest.raises(InputError, match=r"UndefinedError: .*source"):
        write_report(write_run(record))


def test_a_curve_that_is_no_number_is_named_with_its_line(rate_run: Path) -> None:
    traces = rate_run / "traces.csv"
    lines = traces.read_text(encoding="utf-8").splitlines()
    lines[4] = lines[4].rpartition(",")[0] + ",abc"
    traces.write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(InputError, match=r'traces\.csv, line 5, column "best \[mm3/ms\]": "abc"'):
        write_report(rate_run)


def test_a_result_nested_too_deep_is_refused(rate_run: Path) -> None:
    (rate_run / "result.json").write_text("[" * 100_000, encoding="utf-8")
    with pytest.raises(InputError, match=r"\bnot\b.*run folder"):
        write_report(rate_run)


def test_texts_of_the_record_stand_for_its_labels(write_run: WriteRun) -> None:
    record = rate_record() | {"labels": {"rigid": "one mass", "start": "drawing", "best": "fitted"}}
    text = page_of(write_run(record, rate_traces(record))).text
    assert "one mass drawing fitted share, %" in text
    others = ("with the start values", "Origin of the start values")
    assert "start values" not in text.replace(others[0], "").replace(others[1], "")


def test_a_folder_that_is_no_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"\bnot\b.*run folder"):
        write_report(tmp_path)


@pytest.mark.parametrize("number", [errno.EACCES, errno.ENOSPC])
def test_a_report_that_cannot_be_written_says_so(map_run: Path, monkeypatch: pytest.MonkeyPatch, number: int) -> None:
    def refuse(*_: object, **__: object) -> int:
        raise OSError(number, "no")

    monkeypatch.setattr("os.replace", refuse)
    with refused(OutputError, "not-writable", "report.html"):
        write_report(map_run)


def test_a_robust_loss_is_stated_with_its_scale() -> None:
    record = map_record()
    assert "soft L1" not in Page(report_html(record, {})).text
    assert "soft L1 of scale 2" in Page(report_html(record | {"loss": "soft_l1", "loss_scale": 2.0}, {})).text


def test_a_page_with_sliders_beside_the_report_is_linked(rate_run: Path) -> None:
    assert "bench.html" not in write_report(rate_run).read_text(encoding="utf-8")
    (rate_run / "bench.html").write_text("<p>", encoding="utf-8")
    assert 'href="bench.html"' in write_report(rate_run).read_text(encoding="utf-8")


def test_an_interval_of_a_withdrawn_verdict_is_called_so_beside_its_bar() -> None:
    record = rate_record()
    before = Page(report_html(record, rate_traces(record))).text.count("not confirmed")
    record["parameters"][0] |= {"verdict": "not confirmed"}
    # beside the bar, in the key of the bars, and as what the data say in the table, where it stood alone
    assert Page(report_html(record, rate_traces(record))).text.count("not confirmed") >= before + 3
