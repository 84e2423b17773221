"""Files for the tests: the templates as a base, changed in one place each."""

from __future__ import annotations

from collections.abc import Callable
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path

import pytest

TEMPLATES = resources.files("commonrail.plugins.new") / "template"

Edit = Callable[..., Path]


def changed(text: str, *replacements: tuple[str, str]) -> str:
    """The text with each old part, which must stand in it exactly once, replaced."""
    for old, new in replacements:
        assert text.count(old) == 1, f"{old!r} stands {text.count(old)} times"
        text = text.replace(old, new)
    return text


def editor(template: Traversable, path: Path) -> Edit:
    """Function that writes a template with some parts replaced, and returns the path."""

    def write(*replacements: tuple[str, str]) -> Path:
        path.write_text(changed(template.read_text(encoding="utf-8"), *replacements), encoding="utf-8")
        return path

    return write


@pytest.fixture
def injector_file(tmp_path: Path) -> Edit:
    """Write the template's injector with some parts replaced; returns its path."""
    return editor(TEMPLATES / "injector.toml", tmp_path / "mine.toml")


@pytest.fixture
def table_file(tmp_path: Path) -> Callable[[str | bytes], Path]:
    """Write a CSV file; returns its path."""

    def write(text: str | bytes) -> Path:
        path = tmp_path / "data.csv"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


@pytest.fixture
def study_file(tmp_path: Path, injector_file: Edit) -> Edit:
    """Write the template's study, with some parts replaced, beside its injector and data; returns its path."""

    def write(*replacements: tuple[str, str]) -> Path:
        if not (tmp_path / "injector.toml").exists():
            injector_file().rename(tmp_path / "injector.toml")
        (tmp_path / "data").mkdir(exist_ok=True)
        (tmp_path / "data" / "evi.csv").write_bytes((TEMPLATES / "data" / "evi.csv").read_bytes())
        path = tmp_path / "study.toml"
        text = (TEMPLATES / "study.toml").read_text(encoding="utf-8")
        path.write_text(changed(text, *replacements), encoding="utf-8")
        return path

    return write
