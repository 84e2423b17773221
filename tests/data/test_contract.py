"""Every registered kind of measured data keeps the contract, and one that breaks a clause is found out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from commonrail.base.registry import find_shipped
from commonrail.data.base import DataSet
from commonrail.data.curves.data import RateData
from commonrail.data.quantities.data import QuantityData
from commonrail.data.registry import find_kind, in_order, kind_of
from commonrail.physics.injector import Injector
from commonrail.report.data.view import view_of
from tests.data import contract
from tests.data.samples import SAMPLES

KINDS = {name: kind_of(name) for name in find_shipped("data")}
Clause = Callable[[type[DataSet], Injector, Path], None]


def test_every_kind_has_a_sample() -> None:
    assert set(SAMPLES) == set(KINDS)


@pytest.mark.parametrize("clause", contract.CLAUSES, ids=lambda clause: clause.__name__)
@pytest.mark.parametrize("kind", KINDS.values(), ids=list(KINDS))
def test_contract(kind: type[DataSet], clause: Clause, regulated: Injector, tmp_path: Path) -> None:
    clause(kind, regulated, tmp_path)


def test_data_are_ordered_by_kind_and_stay_in_their_order_within(regulated: Injector, tmp_path: Path) -> None:
    read = [SAMPLES[name].truth(KINDS[name], regulated, tmp_path) for name in ("quantities", "rate", "quantities")]
    data = [one.changed(name=str(i)) for i, one in enumerate(read)]
    assert [one.name for one in in_order(data)] == ["1", "0", "2"]


class Unweighted(RateData):
    """Residuals without the weight."""

    def residuals(self, values: Any) -> Any:
        return super().residuals(values) / self.weight


class Forgiving(QuantityData):
    """A failed simulation is as good as the data."""

    def volumes(self, batch: Any, *more: Any) -> Any:
        found = super().volumes(batch, *more)
        return np.where(np.isnan(found), self.quantity, found)


class Flat(QuantityData):
    """One residual for all points."""

    def residuals(self, values: Any) -> Any:
        return super().residuals(values).sum(axis=1, keepdims=True)


class Biased(RateData):
    """J of another curve than the measured one."""

    def misfit(self, values: Any) -> Any:
        return super().misfit(1.01 * values)


class Careless(QuantityData):
    """NaN in the record."""

    def record(self, scores: Any) -> Any:
        return super().record(scores) | {"extra": float("nan")}


class Blind(RateData):
    """Nothing to show."""

    class view:
        has = staticmethod(lambda data, label: False)
        tables = compared_tables = figures = compared_figures = staticmethod(lambda *_: [])


class Anonymous(RateData):
    """Keys that are lost on the way."""

    @classmethod
    def read_all(cls, *arguments: Any) -> Any:
        return [one.changed(name="?") for one in RateData.read_all(*arguments)]


@pytest.mark.parametrize(
    ("kind", "clause"),
    [
        (Unweighted, contract.a_search_and_a_score_agree),
        (Forgiving, contract.a_failed_simulation_costs_everything),
        (Flat, contract.simulation_and_residuals_have_the_data_s_shape),
        (Biased, contract.the_truth_costs_nothing),
        (Careless, contract.a_record_survives_the_file),
        (Blind, contract.tables_and_figures_have_something_to_show),
        (Anonymous, contract.a_block_is_read),
    ],
)
def test_a_kind_that_breaks_the_contract_is_found_out(
    kind: type[DataSet], clause: Clause, regulated: Injector, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # in place of the sound one
    monkeypatch.setattr(
        "commonrail.data.registry.find_kind", lambda name: kind if name == kind.kind else find_kind(name)
    )
    monkeypatch.setattr(contract.views, "view_of", lambda name: getattr(kind, "view", None) or view_of(name))
    with pytest.raises((AssertionError, ValueError)):
        clause(kind, regulated, tmp_path)
