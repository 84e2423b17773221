"""Errors compared by what they are about, not by their words."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from commonrail.base.errors import CommonrailError

Kind = type[CommonrailError] | tuple[type[CommonrailError], ...]


@contextmanager
def refused(kind: Kind, fault: str, file: str = "") -> Iterator[pytest.ExceptionInfo[Any]]:
    """Expect an error with this code and, after a space, place; of the file of this name, if one is given."""
    with pytest.raises(kind) as caught:
        yield caught
    error = caught.value
    assert f"{error.code} {error.place}".rstrip() == fault, str(error)
    assert file in ("", Path(error.file).name)
