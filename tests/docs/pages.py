"""Code of README and docs: the blocks of a page in their order, and how a reader runs them.

A fenced block of `sh` holds command lines, one of `python` statements. A comment before a block says why it is not run,
`<!-- not run: REASON -->`: it takes the reader's own files, installs something or needs a device. A block of `toml` is
the file whose format it states, or part of the one in the comment before it, `<!-- part of: study -->`, or it is not
read, `<!-- not read: REASON -->` (tests/docs/test_toml_blocks.py).
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
README = ROOT / "README.md"
PAGES = [README, *sorted((ROOT / "docs").rglob("*.md"))]

BLOCK = re.compile(
    r"(?:<!-- not run: (?P<reason>[^\n]+?) -->\n+)?"
    r"^(?P<indent> *)```(?P<language>sh|python)\n(?P<code>.*?)^(?P=indent)```",
    re.S | re.M,
)
TOML = re.compile(
    r"(?:<!-- (?P<said>part of|not read): (?P<text>[^\n]+?) -->\n+)?^```toml\n(?P<code>.*?)^```", re.S | re.M
)


@dataclass(frozen=True)
class Block:
    """A block of a page: its language, its code, and why it is not run (empty: it is)."""

    language: str
    code: str
    reason: str


def blocks(page: Path) -> list[Block]:
    """Blocks of shell and Python of a page, in order."""
    found = []
    for match in BLOCK.finditer(page.read_text(encoding="utf-8")):
        code = re.sub(rf"^{match['indent']}", "", match["code"], flags=re.M)
        found.append(Block(match["language"], code, match["reason"] or ""))
    return found


def environment(bin_folder: Path) -> dict[str, str]:
    """Environment in which `commonrail` and `python` are those of this tree."""
    bin_folder.mkdir(exist_ok=True)
    for name, words in {"commonrail": "-m commonrail", "python": ""}.items():
        script = bin_folder / name
        script.write_text(f'#!/bin/sh\nexec "{sys.executable}" {words} "$@"\n', encoding="utf-8")
        script.chmod(0o755)
    path = os.pathsep.join([str(bin_folder), os.environ["PATH"]])
    return os.environ | {"PATH": path, "PYTHONPATH": os.pathsep.join([str(ROOT / "src"), str(ROOT)])}


def run_shell(code: str, folder: Path, env: dict[str, str]) -> None:
    """Run the lines of a block, as bash does; the first that fails is the error."""
    done = subprocess.run(
        ["bash", "-e", "-o", "pipefail", "-c", code], cwd=folder, env=env, capture_output=True, text=True, timeout=1800
    )
    if done.returncode:
        raise AssertionError(f"status {done.returncode}:\n{code}\n{done.stdout[-2000:]}\n{done.stderr[-2000:]}")


def run_python(code: str, names: dict[str, Any], page: Path) -> None:
    """Run a block of Python among the names that earlier blocks of its page made, in the current folder."""
    exec(compile(code, page.name, "exec", dont_inherit=True), names)
