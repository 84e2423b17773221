"""Candidates drawn from an absurdly wide box: each ends with finite figures or a failure that has a name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from commonrail.base.choices import Boundary
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.simulate import simulate_batch
from commonrail.engine.solution import Batch
from commonrail.engine.status import Status
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector, parameter_quantities
from commonrail.physics.law import Domain
from commonrail.physics.variants import Variant
from commonrail.readers.injector import load_injector

BATCH = 1000
RAILS = (1e6, 250e6)  # [Pa]
FACTORS = (0.1, 10.0)  # of every parameter that is not zero


def drawn(injector: Injector, rng: np.random.Generator) -> Batch:
    """One batch at one rail pressure."""
    names = [n for n, value in injector.values.items() if value != 0.0 and n != FUEL_TEMPERATURE]
    own = np.array([injector.values[n] for n in names])
    factors = np.exp(rng.uniform(*np.log(FACTORS), (BATCH, len(names))))
    # ten discharge coefficients above 1 would leave hardly a candidate in its domain
    coefficients = [parameter_quantities()[n].domain is Domain.COEFFICIENT for n in names]
    values = np.where(coefficients, np.minimum(own * factors, 1.0), own * factors)
    rail = float(rng.uniform(*RAILS))
    point = OperatingPoint(rail, 700e-6, min(5e6, 0.5 * rail), min(0.5e6, 0.2 * rail))
    return simulate_batch(injector, [point], names, values)


def check(batch: Batch) -> None:
    """Every candidate has a status; sound ones have finite figures, failed ones none."""
    figures = np.stack([batch.injected_mass, batch.returned_mass])[:, :, 0]
    sound = ~batch.failed[:, 0]
    assert np.isfinite(figures[:, sound]).all()
    assert np.isnan(figures[:, ~sound]).all()
    for status in np.unique(batch.status):
        assert Status(int(status)).sentence.endswith((".", ")."))


def sweep(count: int) -> None:
    drawn_from = load_injector("virtual-lino-2016"), load_injector("cri2-16")
    volume = Variant(boundary=Boundary.VOLUME)  # regulated: the wiring that other tests compile too
    injectors = (*drawn_from, replace(drawn_from[0], variant=volume))
    rng = np.random.default_rng(7)
    seen: set[int] = set()
    for i in range(count // BATCH):
        batch = drawn(injectors[i % len(injectors)], rng)
        check(batch)
        seen |= set(batch.status.ravel().tolist())
    assert {Status.OK, Status.OUTSIDE_DOMAIN, Status.NOT_CLOSED_AT_START} <= {Status(s) for s in seen}


def test_random_candidates_end_with_figures_or_a_name() -> None:
    sweep(6_000)


@pytest.mark.slow
def test_a_million_random_candidates_end_with_figures_or_a_name() -> None:
    sweep(1_000_000)
