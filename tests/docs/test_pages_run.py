"""Commands and Python of README and docs, run as a reader would: in page order, in one folder, after the README's."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Any

import pytest

from tests.docs.pages import PAGES, README, ROOT, Block, blocks, environment, run_python, run_shell


def run_readme(folder: Path, live: bool) -> Path:
    """Run the README's lines in a clone's folder; without `live` reports have no chart that simulates."""
    for name in ("cases", "examples"):
        (folder / name).symlink_to(ROOT / name)
    env = environment(folder.parent / f"bin-{folder.name}")
    for block in blocks(README):
        if block.language == "sh" and not block.reason:
            code = (
                block.code if live else re.sub(r"^(commonrail calibrate .*)$", r"\1 --no-live", block.code, flags=re.M)
            )
            run_shell(code, folder, env)
    assert (folder / "runs" / "first" / "report.html").exists()
    return folder


@pytest.fixture(scope="session")
def after_readme(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder in which the README's lines were run: it holds `my-injector` and `runs/first`."""
    return run_readme(tmp_path_factory.mktemp("reader"), live=True)


@pytest.fixture(scope="session")
def after_readme_quick(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same without what is compiled for a browser, which takes a minute on a fresh machine."""
    return run_readme(tmp_path_factory.mktemp("reader"), live=False)


def copied(done: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Such a folder for one page, which is the current one."""
    copy = tmp_path / "reader"
    shutil.copytree(done, copy, symlinks=True)
    monkeypatch.chdir(copy)
    return copy


def run(shown: list[Block], page: Path, folder: Path) -> None:
    env = environment(folder.parent / "bin")
    names: dict[str, Any] = {"__name__": "__main__"}
    for block in shown:
        if block.reason:
            continue
        if block.language == "sh":
            run_shell(block.code, folder, env)
        else:
            run_python(block.code, names, page)


def named(pages: list[Path]) -> list[Any]:
    return [pytest.param(page, id=page.relative_to(ROOT).as_posix()) for page in pages]


def has(page: Path, language: str) -> bool:
    return any(block.language == language and not block.reason for block in blocks(page))


ALONE = [page for page in PAGES if has(page, "python") and (page == README or not has(page, "sh"))]
TOGETHER = [page for page in PAGES if page != README and has(page, "sh")]


@pytest.mark.process
@pytest.mark.parametrize("page", named(ALONE))
def test_python_of_a_page_runs(
    page: Path, after_readme_quick: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = copied(after_readme_quick, tmp_path, monkeypatch)
    run([block for block in blocks(page) if block.language == "python"], page, folder)


@pytest.mark.slow
@pytest.mark.process
@pytest.mark.parametrize("page", named(TOGETHER))
def test_commands_and_python_of_a_page_run(
    page: Path, after_readme: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = copied(after_readme, tmp_path, monkeypatch)
    run(blocks(page), page, folder)


def test_every_block_of_code_has_a_language() -> None:
    """Blocks without a language would be left out of the tests above."""
    for page in PAGES:
        inside = False
        for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), start=1):
            where = f"{page.name}, line {number}: {line}"
            if line.lstrip().startswith("```"):
                inside = not inside
                language = line.strip().removeprefix("```")
                assert not inside or language in ("sh", "python", "toml", "text", "yaml", "diff", "c", "json"), where
            elif not inside:
                assert not line.startswith(("    commonrail ", "    python ", "    pip ", "    make ")), where


def test_a_line_that_fails_is_found(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match="no-such-verb"):
        run_shell("commonrail no-such-verb\ntrue\n", tmp_path, environment(tmp_path / "bin"))
