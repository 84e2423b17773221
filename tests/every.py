"""Many cases in one test: a test of its own for each costs more than most of the cases."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeVar

import pytest

Case = TypeVar("Case")


def check_every(cases: Iterable[Case], check: Callable[[Case], object]) -> None:
    """Check all cases, then fail with every one that failed. There must be one at least."""
    count, failures = 0, []
    for count, case in enumerate(cases, 1):  # noqa: B007
        try:
            check(case)
        except (Exception, pytest.fail.Exception) as error:
            failures.append(f"{case!r}: {type(error).__name__}: {error}")
    assert count, "no cases"
    assert not failures, f"{len(failures)} of {count} failed\n" + "\n".join(failures)
