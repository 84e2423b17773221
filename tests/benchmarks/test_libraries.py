"""The comparison of the libraries' loops with the compiler's."""

from __future__ import annotations

import pytest

from benchmarks import libraries
from commonrail.compiler.target import SWITCH
from commonrail.engine import machine_code


def test_without_libraries_nothing_is_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine_code, "objection", lambda: "none came with this package")
    with pytest.raises(SystemExit, match="`make kernels`"):
        libraries.main()


def test_the_other_process_may_not_use_them() -> None:
    assert libraries.environment("compiled")[SWITCH] == "off"
    assert libraries.environment("library").get(SWITCH) != "off"
