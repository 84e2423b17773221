"""The engine against theory: Joukowsky, pipe period, modes of the chain, steady flow, mass balance."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from commonrail.physics.injector import Injector
from commonrail.plugins.verification import closed_forms
from commonrail.plugins.verification.closed_forms import Check, check


@pytest.mark.parametrize("form", closed_forms.ALL, ids=lambda form: form.__name__)
def test_engine_agrees_with_the_closed_form(form: Callable[[Injector], list[Check]], pwm: Injector) -> None:
    for one in form(pwm):
        # each limit has its reason in the check's detail
        assert one.passed, f"{one.name}: {one.value:g} {one.unit}, limit {one.limit:g}; {one.detail}"


def test_a_check_that_cannot_be_computed_fails() -> None:
    assert check("", 0.1, 0.1, "%", "").passed
    assert check("", -0.1, 0.1, "%", "").passed
    assert not check("", -0.11, 0.1, "%", "").passed
    assert not check("", float("nan"), 0.1, "%", "").passed


def test_a_margin_is_the_share_of_the_limit_that_is_left() -> None:
    assert check("", -0.25, 1.0, "%", "").margin == 0.75
    assert check("", 2.0, 1.0, "%", "").margin == -1.0
