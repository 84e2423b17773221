"""Texts of files are shown as what they are: on the page, and in its figures."""

from __future__ import annotations

import functools
from typing import Any

import pytest

from commonrail.plugins.compare.page import comparison_html
from commonrail.plugins.paper.page import reproduction_html
from commonrail.report.page import report_html
from tests.plugins.compare.samples import compared_rates, compared_traces
from tests.report.reproduction_sample import record as record_of_a_reproduction
from tests.report.reproduction_sample import traces as traces_of_a_reproduction
from tests.report.samples import rate_record, rate_traces
from tests.report.test_build import Page

TEXTS = {
    "script": "<script>alert(1)</script>",
    "end of script": "a</script><script>alert(1)//",
    "end of script in capitals": "</SCRIPT ><svg onload=alert(1)>",
    "quotes": "\"' onmouseover='alert(1)' x=\"",
    "link": '<a href="javascript:alert(1)">x</a>',
    "comment": "<!--<script>",
    "template": "{{ 7 * 7 }}{% raw %}{# x #}",
    "line separators": "a\u2028b\u2029c",
    "entities": "&lt;b&gt;&#60;&amp;",
}
NAMES = (
    "title",
    "name",
    "source",
    "synthetic",
    "note",
    "meaning",
    "variant",
    "fuel",
    "reason",
    "claim",
    "comment",
    "sentence",
)


def poisoned(value: Any, text: str, key: str = "") -> Any:
    """The record with the text at the end of everything that a user has named."""
    if isinstance(value, dict):
        return {k: poisoned(v, text, k) for k, v in value.items()}
    if isinstance(value, list):
        return [poisoned(v, text, key) for v in value]
    return value + text if value and isinstance(value, str) and key in NAMES else value


def warned() -> dict[str, Any]:
    """Record of a calibration with a warning."""
    return rate_record() | {"warnings": [{"code": "sign", "subject": "EVI", "sentence": "Negative."}]}


@functools.cache
def calibration() -> Page:
    """The page without a hostile text, made once; so are the next two."""
    record = warned()
    return Page(report_html(record, rate_traces(record)))


@functools.cache
def comparison() -> Page:
    record = compared_rates()
    return Page(comparison_html(record, compared_traces(record)))


@functools.cache
def reproduction() -> Page:
    return Page(reproduction_html(record_of_a_reproduction(), traces_of_a_reproduction()))


def check(page: str, reference: Page, text: str) -> None:
    """The text has made no element, no attribute and no script, and can be read."""
    own = Page(page)
    assert [tag for tag, _ in own.tags if tag != "wbr"] == [tag for tag, _ in reference.tags if tag != "wbr"]
    assert {key for _, found in own.tags for key in found} == {key for _, found in reference.tags for key in found}
    assert " ".join(text.split()) in own.text


def plotted(page: str) -> list[str]:
    """Names of the curves in the figures of a page."""
    return [name for _, found in Page(page).tags if (name := found.get("data-name"))]


@pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS)
def test_page_of_a_calibration(text: str) -> None:
    record = warned()
    traces = rate_traces(record)
    spoilt = {name + text: trace for name, trace in traces.items()}
    check(report_html(poisoned(record, text), spoilt), calibration(), text)


@pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS)
def test_page_of_a_comparison_and_its_figures(text: str) -> None:
    record = compared_rates()
    traces = compared_traces(record)
    named = poisoned(record, text) | {"labels": {label: shown + text for label, shown in record["labels"].items()}}
    page = comparison_html(named, {name + text: trace for name, trace in traces.items()})
    check(page, comparison(), text)
    names = plotted(page)
    assert sum(name.endswith(text) for name in names) >= 9  # three models on three curves


@pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS)
def test_page_of_a_reproduction(text: str) -> None:
    named = poisoned(record_of_a_reproduction(), text) | {"data": record_of_a_reproduction()["data"]}
    for row, own in zip(named["table1"], record_of_a_reproduction()["table1"], strict=True):
        row["name"] = own["name"]  # a parameter of the program
    check(reproduction_html(named, traces_of_a_reproduction()), reproduction(), text)
