"""Readers of foreign formats in the process of the tests: to start another one and asammdf in it takes seconds."""

from __future__ import annotations

import json
from importlib import import_module
from typing import IO

import pytest

from commonrail.reading import child, guarded_child

__all__ = ["read_in_process"]


def _run(args: list[str], data: bytes, stream: IO[bytes]) -> int:
    reader, options, memory, _ = args
    child.write(
        stream, import_module(f"commonrail.reading.child_{reader}").read, data, json.loads(options), int(memory)
    )
    return 0


def read_in_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace the child process, and forget what was read before under other limits."""
    monkeypatch.setattr(guarded_child, "_run", _run)
    guarded_child._cached.cache_clear()
