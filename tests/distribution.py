"""Distribution of another package on the path, with parts registered by entry points."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import pytest

from commonrail.base import registry


@contextmanager
def distribution(folder: Path, modules: Mapping[str, str], parts: str) -> Iterator[None]:
    """Install example-plugin 1.2 in the block.

    Parameters
    ----------
    folder : Path
        Empty.
    modules : mapping of str to str
        Source text by the name of the module.
    parts : str
        Content of entry_points.txt.
    """
    for name, text in modules.items():
        (folder / f"{name}.py").write_text(text, encoding="utf-8")
    info = folder / "example_plugin-1.2.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: example-plugin\nVersion: 1.2\n", encoding="utf-8")
    (info / "entry_points.txt").write_text(parts, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        registry.installed.cache_clear()
        yield
    for name in modules:
        sys.modules.pop(name, None)
    registry.installed.cache_clear()
