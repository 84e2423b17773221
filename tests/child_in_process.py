"""Readers of foreign formats in the process of the tests: to start another one and asammdf in it takes seconds."""

from __future__ import annotations

import json
from importlib import import_module
from typing import IO

import pytest

from commonrail.readers import guarded

__all__ = ["read_in_process"]


def read_in_process(monkeypatch: pytest.MonkeyPatch, *apart: str) -> None:
    """Replace the child process of all readers but some, and forget what was read before under other limits."""
    start = guarded._run

    def run(args: list[str], data: bytes, stream: IO[bytes]) -> int:
        reader, options, memory, _ = args
        if reader.rpartition(".")[2].removesuffix("_child") in apart:
            return start(args, data, stream)
        guarded.write(stream, import_module(reader), data, json.loads(options), int(memory))
        return 0

    monkeypatch.setattr(guarded, "_run", run)
    guarded._cached.cache_clear()
