"""Tests of the certainty of a fit have as many draws as the user."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.judging import WHOLE, judged_by


@pytest.fixture(scope="module", autouse=True)
def as_for_the_user() -> Iterator[None]:
    with judged_by(WHOLE):
        yield
