"""Contact: pushes only; the damping grows with the overlap (Hunt and Crossley)."""

from __future__ import annotations

from commonrail.flow.contact import contact


def test_overlap_pushes_by_k_depth_and_damps_by_beta_times_that() -> None:
    assert contact(3e-6, 2e8, 0.2) == (600.0, 120.0)


def test_bodies_apart_do_not_pull() -> None:
    assert contact(-1e-6, 2e8, 0.2) == (0.0, 0.0)
    assert contact(0.0, 2e8, 0.2) == (0.0, 0.0)
