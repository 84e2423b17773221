"""Words of the trade on the pages and in the help: phrases that a reader would have to guess are not used."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.test_pages import PAGES, ROOT, VERBS

TEXTS = {page.relative_to(ROOT).as_posix(): page for page in [*PAGES, ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md"]}

# Phrase, and what to write.
INSTEAD = {
    r"\bgo(es|ne|ing)? on\b": "resume, continue",
    r"\blengthen": "extend",
    r"\bhand(s|ed|ing)? on\b": "pass on",
    r"\bnobody\b|\bsomebody\b": "empty; another process, anyone",
    r"\bgreatest\b": "largest",
    r"\bleast\b(?! squares| certain)(?<!\bat least)": "smallest",
    r"\bleft out\b|\bleave[s]?\b[^.]*\baway\b": "omit, omitted",
    r"\bof no account\b": "ignored",
    r"\bto be had\b|\bat hand\b": "available",
    r"\b(is|are|was|were|be|cannot be) told\b": "reported, given, found",
    r"\bstands? (in|beside|below|at|together|for)\b": "is in, is beside, means",
    r"\bworked out\b": "computed",
    r"\bgiv(e|es|en) (free|up)\b": "release",
    r"\bwhat is left away\b": "omitted",
    r"\bspoilt\b": "damaged",
    r"\bit goes\b": "it continues",
    r"\b(injections|simulations|candidates|cycles|injectors|f64,|f32,|ms of simulated time) a second\b": "per second",
    r"\bas many as\b[^.]*\bfastest\b": "one per ... is fastest",
    r"\bshy\b|\b(computers?|machines?|disks?) that (lie|says?|keeps what)\b": "what the machine does",
}
# Tables that a tool writes from records, code, names.
EXCERPTS = re.compile(r"<!-- \w+ -->.*?<!-- end -->|^ *```.*?^ *```|^ {4,}[^\n]*$|`[^`]*`", re.S | re.M)


def found(text: str) -> dict[str, str]:
    """Phrases of a text that have better words, and these."""
    plain = re.sub(r"\s+", " ", EXCERPTS.sub(" ", text))
    return {match.group(): better for phrase, better in INSTEAD.items() for match in re.finditer(phrase, plain, re.I)}


@pytest.mark.parametrize("page", TEXTS)
def test_a_page_uses_the_words_of_the_trade(page: str) -> None:
    assert found(TEXTS[page].read_text(encoding="utf-8")) == {}


@pytest.mark.parametrize("folder", ["src", "tests", "tools", "benchmarks"])
def test_a_docstring_opens_with_the_noun_or_the_verb(folder: str) -> None:
    asking = re.compile(r'^\s*"""(What|Who|How|Where|Whether|When|Which|Why)\b[^\n]*', re.M)
    found = {path.relative_to(ROOT).as_posix(): asking.search(path.read_text("utf-8")) for path in sources(folder)}
    assert len(found) > 5
    assert {path: match.group().strip() for path, match in found.items() if match} == {}


def sources(folder: str) -> list[Path]:
    """Python files of a folder of the repository."""
    return sorted((ROOT / folder).rglob("*.py"))


@pytest.mark.parametrize("verb", VERBS)
def test_the_help_uses_the_words_of_the_trade(verb: str) -> None:
    command = VERBS[verb]
    helps = [str(getattr(p, "help", "") or "") for p in command.params]
    assert found("\n".join([command.help or "", *helps])) == {}


@pytest.mark.parametrize("verb", VERBS)
def test_the_help_of_each_option_starts_with_the_thing(verb: str) -> None:
    options = [p for p in VERBS[verb].params if p.param_type_name == "option"]  # arguments may have no help
    helps = {p.name: str(getattr(p, "help", "") or "") for p in options}
    helps.pop("help", None)
    assert {
        name: text
        for name, text in helps.items()
        if re.match(r"$|(With|Of|Instead|Also|Behind|All|If|For)\b(?! measure)", text)
    } == {}


def test_a_phrase_is_found_across_lines_and_not_in_code() -> None:
    assert found("The run goes\non.") == {"goes on": "resume, continue"}
    assert found("The key `goes on` is a name.") == {}
