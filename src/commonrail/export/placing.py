"""Folder whose files appear when all of them are complete."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = ["placed"]


@contextmanager
def placed(folder: Path) -> Iterator[Path]:
    """Empty folder to write into; when the block ends without an error, its files are those of `folder`.

    A new folder appears at once. In one that exists, each file takes the place of that of its name, and others stay.
    After an error nothing has changed.

    Parameters
    ----------
    folder : Path
        Made where it is missing, with the folders above it.
    """
    exists = folder.exists()
    if not exists:
        folder.parent.mkdir(parents=True, exist_ok=True)
    own = Path(tempfile.mkdtemp(prefix=".commonrail-", dir=folder if exists else folder.parent))
    made = own / "made"  # with the permissions that a new folder has
    made.mkdir()
    try:
        yield made
        if exists:
            _replace_files(made, folder)
        else:
            os.rename(made, folder)
    finally:
        shutil.rmtree(own, ignore_errors=True)


def _replace_files(made: Path, folder: Path) -> None:
    files = [path for path in sorted(made.rglob("*")) if not path.is_dir()]
    for path in files:
        target = folder / path.relative_to(made)
        target.parent.mkdir(parents=True, exist_ok=True)
        os.replace(path, target)
