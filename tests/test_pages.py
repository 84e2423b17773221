"""Commands in README and docs, also those that are not run: verbs and options exist, and files of the README's."""

from __future__ import annotations

import ast
import re
import shlex
import tomllib
from collections.abc import Iterator
from pathlib import Path

import click

import commonrail as cr
from commonrail.cli.grammar import cli
from commonrail.plugins import SHIPPED
from tests.every import check_every

ROOT = Path(__file__).resolve().parents[1]
README = ROOT / "README.md"
PAGES = [README, *sorted((ROOT / "docs").rglob("*.md")), *sorted((ROOT / "cases").rglob("*.md"))]

VERBS = {name: cli.get_command(click.Context(cli), name) for name in SHIPPED["verbs"]}
SHELL = ("|", ">", "&&", ";")  # end a command
OUTPUTS = ("--out", "--report")  # what a command writes, a later one may take


def blocks(text: str) -> Iterator[str]:
    """Code of a page: fenced blocks without a language or of a shell, and indented lines."""
    for language, body in re.findall(r"^```(\w*)\n(.*?)^```", text, re.S | re.M):
        if language in ("", "sh", "bash", "console"):
            yield body
    without = re.sub(r"^```.*?^```", "", text, flags=re.S | re.M)
    yield "\n".join(line[4:] for line in without.splitlines() if line.startswith("    "))
    yield "\n".join(re.findall(r"`(commonrail [^`\n]+)`", without))


def commands(page: Path, *programs: str) -> list[list[str]]:
    """Words of every command line of a page that runs one of the programs."""
    found = []
    for block in blocks(page.read_text(encoding="utf-8")):
        for line in block.replace("\\\n", " ").splitlines():
            if line.split(" ")[0] in programs:
                words = shlex.split(line, comments=True)
                found.append(words[: next((i for i, word in enumerate(words) if word in SHELL), None)])
    return found


def refusal(words: list[str]) -> str:
    """Objection of a verb to a command line that is read but not run; empty if it accepts it."""
    if words[1] not in VERBS:
        return f"there is no verb {words[1]}"
    try:
        VERBS[words[1]].make_context(words[1], words[2:])
    except click.ClickException as error:
        return error.format_message()
    except click.exceptions.Exit:  # of --help
        pass
    return ""


def is_sketch(words: list[str]) -> bool:
    """Return whether a line shows the form of a command, as `[--out DIR]` does, or names a verb in the text."""
    return len(words) < 3 or any(re.search(r"[\[\]…]|^[A-Z]{2,}$|^\.\.\.$", word) for word in words[2:])


def test_every_command_line_of_a_page_is_accepted() -> None:
    check_every(PAGES, check_command_lines)


def check_command_lines(page: Path) -> None:
    for words in commands(page, "commonrail"):
        if words[1:2] and words[1].startswith("-"):
            continue  # --help and --version of the command itself
        if is_sketch(words):
            assert words[1] in VERBS, words
            continue
        assert refusal(words) == "", shlex.join(words)


def test_a_wrong_line_is_refused() -> None:
    assert "no-such-option" in refusal(["commonrail", "simulate", "cri2-16", "--no-such-option"])
    assert "no verb" in refusal(["commonrail", "simulatte", "cri2-16"])


def looks_like_a_file(word: str) -> bool:
    return bool(re.fullmatch(r"[\w./-]*(/|\.(toml|csv|html|json|py))[\w./-]*", word))


def test_every_file_in_the_readmes_commands_is_there_or_was_made_before() -> None:
    made: set[str] = set()
    lines = commands(README, "commonrail", "python")
    assert any("calibrate" in words for words in lines)  # the pattern finds them
    for words in lines:
        outputs = {words[i + 1] for i, word in enumerate(words[:-1]) if word in OUTPUTS}
        if words[1] == "new":
            outputs.add(words[2])
        for word in words[1:]:
            name = word.rpartition("=")[2]
            if name in outputs or not looks_like_a_file(name):
                continue
            was_made = any(name == each or name.startswith(f"{each}/") for each in made)
            holds_runs = any(each.startswith(f"{name}/") for each in made)
            assert (ROOT / name).exists() or was_made or holds_runs, f"{shlex.join(words)}: {name} does not exist"
        made |= outputs


def test_the_injectors_in_the_readmes_commands_are_of_the_catalogue() -> None:
    known = set(cr.models.injector_catalogue())
    for words in commands(README, "commonrail"):
        if words[1] == "simulate":
            assert words[2] in known, shlex.join(words)


def test_the_targets_in_the_readme_are_those_of_the_makefile() -> None:
    targets = set(re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M))
    named = {words[1] for words in commands(README, "make")}
    assert named
    assert named <= targets


def test_the_readmes_python_names_what_there_is() -> None:
    (code,) = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.S)
    tree = ast.parse(code)
    attributes = [node for node in ast.walk(tree) if isinstance(node, ast.Attribute)]
    names = {node.attr for node in attributes if isinstance(node.value, ast.Name) and node.value.id == "cr"}
    assert names
    assert names <= set(cr.__all__)
    texts = {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str)}
    for text in texts:
        assert not looks_like_a_file(text) or (ROOT / text).exists(), text


def test_every_link_of_a_page_leads_to_a_file() -> None:
    """Pages that are made for the site alone are not among them: the links would be dead where the source is read."""
    for page in [README, *sorted((ROOT / "docs").rglob("*.md"))]:
        for target in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
            there = "://" in target or target.startswith("mailto:") or (page.parent / target).exists()
            assert there, f"{page.name}: {target}"


def test_the_pairs_of_plug_ins_are_those_that_the_decision_lists() -> None:
    (decision,) = (ROOT / "docs" / "decisions").glob("0021-*.md")
    rows = re.findall(r"^\| (\w+) \| ([\w, ]+) \|$", decision.read_text(encoding="utf-8"), re.M)
    listed = {(plugin, other) for plugin, others in rows for other in others.split(", ") if plugin != "plug"}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    (contract,) = (one for one in project["tool"]["importlinter"]["contracts"] if one["id"] == "plugins")
    words = (re.findall(r"plugins\.(\w+)", pair) for pair in contract["ignore_imports"])
    assert listed == {tuple(pair) for pair in words}
