"""The verb `page`: what it writes and says, and its sentences where it cannot."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import pytest

from commonrail.base.errors import InputError
from commonrail.base.hooks import ALL_ENTRIES, duration
from commonrail.cli import console
from commonrail.physics.variants import Variant
from commonrail.plugins.export import fmu, library, object_files
from commonrail.plugins.page import module, page
from tests.cli.conftest import run_command

needs_zig = pytest.mark.skipif(importlib.util.find_spec("ziglang") is None, reason="ziglang is not installed")


@needs_zig
def test_it_writes_one_file_and_says_its_size(tmp_path: Path) -> None:
    out = tmp_path / "bench.html"
    done = run_command("page", "virtual-lino-2016", "--out", out, "--slider", "sac.volume")
    assert done.status == 0
    assert f"wrote {out} (" in done.err
    assert '"name":"sac.volume"' in out.read_text(encoding="utf-8")
    record = run_command("page", "virtual-lino-2016", "--out", out, "--rail-pressure", "120MPa", "--json").record
    assert record == {"kind": "page", "page": str(out), "bytes": out.stat().st_size}
    assert '"rail":120000000.0' in out.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("no-such-injector",), "or injector"),
        (("virtual-lino-2016", "--slider", "nozzle.hols"), "nozzle.hols: "),
        (("virtual-lino-2016", "--rail-pressure", "900MPa"), "declared from"),
        (("virtual-lino-2016", "--energising-time", "7 apples"), "--energising-time"),
    ],
)
def test_what_it_cannot_use_is_a_sentence(tmp_path: Path, arguments: tuple[str, ...], sentence: str) -> None:
    done = run_command("page", *arguments, "--out", tmp_path / "bench.html")
    assert done.status == 2
    assert sentence in done.sentence
    assert not (tmp_path / "bench.html").exists()


def test_without_zig_it_names_what_to_install(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def missing(name: str, *rest: Any) -> None:
        return None

    monkeypatch.setattr(object_files.importlib.util, "find_spec", missing)
    monkeypatch.setattr(module, "get_or_make", lambda name, make: make())  # as on the first day
    done = run_command("page", "virtual-lino-2016", "--out", tmp_path / "bench.html")
    assert done.status == 2
    assert "'commonrail[export]'" in done.sentence


def test_what_is_compiled_for_a_page_is_said_once(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(console, "_said_once", set())
    with console.compiling(), console.compiling():  # the module needs the text of the physics
        pass
    with console.compiling():  # and the fits near the best one their kernel
        pass
    assert capsys.readouterr().err.count(console.COMPILING) == 1


def test_a_page_and_an_export_say_that_they_compile_for_a_minute(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """They compile more than the one kernel of a simulation, and zig the C library of the browser's platform."""

    def compiled(*_: Any) -> Any:
        with console.compiling():
            raise InputError("enough is said")

    monkeypatch.setattr(page, "wasm_module", compiled)
    monkeypatch.setattr(library, "make_model", compiled)
    monkeypatch.setattr(fmu, "make_model", compiled)
    calls = (("page", "cri2-16", "--out", "b.html"), ("export", "library", "cri2-16"), ("export", "fmu", "cri2-16"))
    monkeypatch.chdir(tmp_path)
    for words in calls:
        monkeypatch.setattr(console, "_said_once", set())
        assert f"{console.COMPILING} ({ALL_ENTRIES})" in run_command(*words).err
    assert duration().startswith("ten seconds on an idle machine")


def test_a_report_makes_the_page_of_its_run_alone(tmp_path: Path) -> None:
    done = run_command("report", tmp_path, "--page")
    assert done.status == 2
    assert "--page needs" in done.sentence
    assert not (tmp_path / "bench.html").exists()


@needs_zig
def test_the_module_imports_nothing() -> None:
    """The sections of a module follow its header, each with its number and length; imports are section 2."""
    found = module.wasm_module(Variant(drive="pwm"))
    assert found[:8] == b"\0asm\1\0\0\0"
    sections, at = [], 8
    while at < len(found):
        number, at = found[at], at + 1
        length = shift = 0
        while True:
            byte, at = found[at], at + 1
            length |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                break
        sections.append(number)
        at += length
    assert at == len(found)
    assert 2 not in sections
    assert len(found) < 100_000
