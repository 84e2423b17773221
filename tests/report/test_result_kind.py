"""Kinds of result of other packages: their folders are reported, and their results shown, like those that ship."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from commonrail.base.display import Shown
from commonrail.base.errors import InputError
from commonrail.report.result_kind import kind_of
from tests.cli.conftest import run_command
from tests.distribution import distribution

PLUGIN = """
from commonrail.report.presenter import Presenter
from commonrail.report.result_kind import ResultKind


def extra(folder):
    (folder / "sprays.svg").write_text("<svg/>", encoding="utf-8")
    return "sprays.svg is drawn without shadows"


def page(record, folder):
    return f"<p>{record['angle']} degrees in {folder.name}</p>"


SPRAY = ResultKind("spray.json", "spray", "spray", page, ("angle",), extra=extra)
SHOWN = Presenter(lambda result: [f"cone of {result.angle} degrees"])
"""


@pytest.fixture
def plugin(tmp_path: Path) -> Iterator[None]:
    (tmp_path / "path").mkdir()
    parts = "[commonrail.results]\nspray.json = example_spray:SPRAY\n"
    with distribution(tmp_path / "path", {"example_spray": PLUGIN}, parts):
        yield


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Folder with the record of a spray."""
    folder = tmp_path / "sprays-1"
    folder.mkdir()
    record = {"schema": 1, "kind": "spray", "angle": 14}
    (folder / "spray.json").write_text(json.dumps(record), encoding="utf-8")
    return folder


@pytest.mark.usefixtures("plugin")
def test_the_record_of_another_package_is_reported(folder: Path) -> None:
    done = run_command("report", folder)
    assert done.status == 0
    assert (folder / "report.html").read_text(encoding="utf-8") == "<p>14 degrees in sprays-1</p>"
    assert (folder / "sprays.svg").is_file()
    assert "without shadows" in done.err


def test_without_the_package_it_is_no_run_folder(folder: Path) -> None:
    assert run_command("report", folder).status == 2
    assert not (folder / "report.html").exists()


@pytest.mark.usefixtures("plugin")
@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"kind": "map"}, "result of commonrail spray"),
        ({"schema": 2}, "another version .*; spray"),
        ({"angle": None}, 'lacks "angle"; spray'),
    ],
)
def test_a_record_that_the_page_cannot_read_is_refused(folder: Path, change: dict[str, object], words: str) -> None:
    record = json.loads((folder / "spray.json").read_text(encoding="utf-8")) | change
    kept = {key: value for key, value in record.items() if value is not None}
    (folder / "spray.json").write_text(json.dumps(kept), encoding="utf-8")
    with pytest.raises(InputError, match=words):
        kind_of(folder).read(folder)


@pytest.mark.usefixtures("plugin")
def test_a_class_of_another_package_names_its_presenter() -> None:
    class Spray(Shown):
        presenter = "example_spray:SHOWN"
        angle = 14

    assert repr(Spray()) == "<Spray: cone of 14 degrees>"
    assert "<p>cone of 14 degrees</p>" in Spray()._repr_html_()
