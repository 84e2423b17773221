"""The command as a whole: help, version, usage, start-up."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from click.shell_completion import ShellComplete

from commonrail.cli.grammar import cli
from commonrail.plugins import SHIPPED
from tests.cli.conftest import Command

VERBS = SHIPPED["verbs"]
HEAVY = ["jinja2", "numba", "numpy", "matplotlib", "pydantic", "scipy", "tomlkit"]


def test_the_help_lists_every_verb_in_full(command: Command) -> None:
    done = command("--help")
    assert done.status == 0
    headings = done.out.split("exit.\n")[1].split("\n\n")
    listed = [line.split() for part in headings for line in part.strip().splitlines()[1:]]
    assert sorted(words[0] for words in listed) == sorted(name for name in VERBS if " " not in name)
    assert not any(words[-1].endswith("...") for words in listed)


@pytest.mark.parametrize("verb", [name for name in VERBS if name != "lab"])
def test_every_verb_has_an_example_and_json(command: Command, verb: str) -> None:
    done = command(*verb.split(), "--help")
    assert done.status == 0
    assert f"commonrail {verb}" in done.out.split("Example")[1]
    assert "--json" in done.out


RUNS_HELP = """\
Usage: commonrail runs [OPTIONS] [DIR]

  List runs with state, best objective and age.

  "stopped" means killed. `commonrail resume` resumes runs that are stopped,
  interrupted or failed.

  Example:
    commonrail runs runs
    commonrail runs runs --html runs.html

Arguments:
  [DIR]  Folder with run folders in it. [default: runs]

Options:
  --html FILE.html  Page to be written: runs in a table, their parameters,
                    curves and studies.
  --full            Print all rows, columns and tables, in place of 10 lines.
  --json            Print the result as one JSON object in SI units on stdout.
  -h, --help        Show this message and exit.
"""


def test_the_help_of_a_verb_reads_so(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert command("runs", "--help").out == RUNS_HELP


def test_a_shell_completes_verbs_options_and_their_values() -> None:
    complete = ShellComplete(cli, {}, "commonrail", "_COMMONRAIL_COMPLETE")

    def found(*before: str, last: str) -> list[str]:
        return [item.value for item in complete.get_completions(list(before), last)]

    assert found(last="sim") == ["simulate"]
    assert found("simulate", "cri2-16", last="--rail") == ["--rail-pressure"]
    assert found("simulate", "cri2-16", "--engine", last="ref") == ["reference"]


def test_the_version_is_printed(command: Command) -> None:
    import commonrail

    assert command("--version").out == f"commonrail {commonrail.__version__}\n"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("simulat",), "simulate"),
        (("simulate", "x", "--rail-presure", "1MPa"), "--rail-pressure"),
        (("simulate", "x"), "--rail-pressure"),
        (("catalogue", "fuel"), "fuels"),
        (("calibrate", "x.toml", "--threads", "0"), "threads"),
    ],
)
def test_wrong_usage_ends_with_2_and_names_what_is_meant(
    command: Command, arguments: tuple[str, ...], words: str
) -> None:
    done = command(*arguments)
    assert done.status == 2
    assert done.out == ""
    assert words in done.err


def test_the_help_imports_nothing_heavy() -> None:
    code = "import sys; from commonrail.cli.grammar import cli; cli(['--help'], standalone_mode=False);"
    code += f"print('heavy:', *(name for name in {HEAVY} if name in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "heavy:"


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("certainty", "small/study.toml"), "`commonrail calibrate small/study.toml --out RUN` makes one"),
        (("predict", "small"), "`commonrail calibrate small/study.toml --out RUN` makes one"),
        (("next", "cri2-16"), "no such folder"),
        (("calibrate", "small"), '"small/study.toml"?'),
        (("map", "cri2-16", "--rail-pressure", "40-160MPa"), "20:180:10MPa"),
        (("sensitivity", "cri2-16"), "--rail-pressure and --energising-time"),
        (("export", "simulink", "cri2-16"), "'library', 'fmu'"),
        (("export", "fmuu", "cri2-16"), '"fmu"?). `commonrail export --help`'),
        (("adapt", "cri2-16", "--from", "p.csv", "--out", "m.toml"), "`commonrail type RUN --out TYPE.toml` makes one"),
        (("adapt", "small", "--from", "p.csv", "--out", "m.toml"), "`commonrail type RUN --out TYPE.toml` makes one"),
        (("simulate", "crin", "--rail-pressure", "-80MPa", "--energising-time", "1ms"), "-80 MPa"),
        (
            ("sensitivity", "crin", "--feature", "quantty", "--rail-pressure", "80MPa", "--energising-time", "1ms"),
            '"quantity"?)',
        ),
        (("sensitivity", "small/study.toml", "--feature", "quantity"), "--feature"),
    ],
)
def test_what_is_no_run_study_or_range_is_answered_by_what_to_do(
    command: Command, study: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], told: str
) -> None:
    monkeypatch.chdir(study.parent.parent)
    done = command(*words)
    assert done.status == 2
    assert told in done.sentence
