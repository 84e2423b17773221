"""Every way in which a verb can end badly is one sentence and a status."""

from __future__ import annotations

import json
import re
from pathlib import Path

import click
import pytest

from commonrail.base import errors
from commonrail.cli.grammar import Verbs, cli
from commonrail.plugins import MEMORY
from commonrail.runs.folder import read_record, write_record
from tests.cli.conftest import Command, Done, run_command


def end_with(error: BaseException, *words: str, name: str = "runs") -> Done:
    """Run a verb that raises in place of one of the command."""

    def verb() -> None:
        raise error

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Verbs, "get_command", lambda *_: click.Command(name, callback=verb))
        return run_command(*words, name)


@pytest.mark.parametrize(
    ("error", "status", "sentence"),
    [
        (errors.InputError("a.toml: no such file."), 2, "a.toml: no such file."),
        (errors.ConfigurationError("x contradicts y."), 2, "x contradicts y."),
        (errors.StudyError("no data."), 2, "no data."),
        (errors.OutputError("disk full."), 3, "disk full."),
        (errors.SimulationError("failed."), 4, "failed."),
        (errors.InputError("two\n  lines."), 2, "two lines."),
        (PermissionError(13, "Permission denied", "x.csv"), 2, "x.csv: Permission denied."),
        (KeyboardInterrupt(), 130, "interrupted."),
        (
            ModuleNotFoundError("No module named 'llvmlite.binding'", name="llvmlite.binding"),
            2,
            "this needs machine code that no library of this installation holds, and the package llvmlite, which "
            "compiles it, is not installed: pip install 'commonrail[jit]'.",
        ),
        (
            ModuleNotFoundError("No module named 'scipy'", name="scipy"),
            2,
            "the package scipy, which this needs, is not installed: pip install scipy.",
        ),
        (MemoryError(), 2, "not enough memory; close other programs or take a machine with more."),
    ],
)
def test_an_error_is_one_line_on_stderr(error: BaseException, status: int, sentence: str) -> None:
    assert end_with(error) == Done(status, "", f"commonrail: {sentence}\n")


@pytest.mark.parametrize("error", [ZeroDivisionError("a\nb"), ModuleNotFoundError("a b", name="commonrail.absent")])
def test_a_fault_of_the_program_asks_for_a_report(error: Exception) -> None:
    done = end_with(error)
    assert done.status == 1
    assert done.err.startswith(f"commonrail: internal fault ({type(error).__name__}: a b); please")
    assert done.err.count("\n") == 1


@pytest.mark.parametrize(("words", "variable"), [(["--traceback"], ""), ([], "1")])
def test_a_traceback_is_shown_on_demand(monkeypatch: pytest.MonkeyPatch, words: list[str], variable: str) -> None:
    monkeypatch.setenv("COMMONRAIL_TRACEBACK", variable)
    done = end_with(ZeroDivisionError("a"), *words)
    assert "Traceback" in done.err
    assert done.err.splitlines()[-1].startswith("commonrail: internal fault")


def test_an_end_of_click_is_left_to_click() -> None:
    done = end_with(click.exceptions.Exit(5))
    assert done.status == 5
    assert "commonrail:" not in done.err


def test_a_mistaken_option_ends_with_one_sentence(command: Command) -> None:
    for words, told in (
        (("map", "cri2-16", "--cylinder-presure", "5MPa"), "--cylinder-pressure"),
        (("simulate", "cri2-16", "--rail-pressure"), "commonrail simulate --help"),
        (("--trace",), "--traceback"),
        (("lab", "verfy"), "verify"),
        (("reproduce", "--quick"), "lab reproduce"),
    ):
        done = command(*words)
        assert done.status == 2
        assert told in done.sentence
        assert "Usage" not in done.err


@pytest.mark.parametrize("name", MEMORY)
def test_the_cure_of_too_little_memory_is_one_that_the_verb_has(name: str) -> None:
    verb = cli.get_command(click.Context(cli), name)
    options = {option for part in verb.params for option in part.opts}
    assert set(re.findall(r"--[a-z-]+", MEMORY[name])) <= options
    assert ("--workers" in MEMORY[name]) == ("--workers" in options)


def test_the_cure_of_too_little_memory_is_that_of_the_verb() -> None:
    assert MEMORY["fleet"] in end_with(MemoryError(), name="fleet").sentence


@pytest.mark.parametrize("sign", ["\x1b", "\r", "\x9b", "\u202e"])
def test_a_folder_whose_name_a_terminal_obeys_is_refused(tmp_path: Path, sign: str) -> None:
    (folder := tmp_path / f"a{sign}[31mb").mkdir()
    done = run_command("runs", folder)
    assert done.status == 2
    assert sign not in done.out + done.sentence


@pytest.mark.parametrize("text", ["\x1b[2J", "\r", "\x9b", "\u202e"])
def test_a_record_holds_nothing_that_a_terminal_obeys(tmp_path: Path, text: str) -> None:
    path = tmp_path / "result.json"
    write_record(path, {"title": f"a{text}", "path": "C:\\\\ready", "name": "µ\n\t–"})
    assert read_record(path, "commonrail calibrate")["path"] == "C:\\\\ready"
    assert read_record(path, "commonrail calibrate")["name"] == "µ\n\t–"
    for ascii_only in (True, False):
        path.write_text(json.dumps({"title": text}, ensure_ascii=ascii_only), encoding="utf-8")
        with pytest.raises(errors.InputError):
            read_record(path, "commonrail calibrate")
