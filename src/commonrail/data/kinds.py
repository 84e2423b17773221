"""Kinds of measured data by their `kind` in study files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import reduce
from operator import or_
from types import UnionType

from commonrail.data.base import DataSet, Role
from commonrail.data.curves.data import RateData
from commonrail.data.feature_targets.data import FeatureData
from commonrail.data.quantities.data import QuantityData
from commonrail.data.quantities.returned import ReturnData

# By `kind` in files; an objective, a report and its tables take them in this order.
KINDS: Mapping[str, type[DataSet]] = {kind.kind: kind for kind in (RateData, QuantityData, ReturnData, FeatureData)}
ANY_KIND: UnionType = reduce(or_, KINDS.values())  # type: ignore[assignment]  # or_ of types is a union


def in_order(data: Sequence[DataSet]) -> tuple[DataSet, ...]:
    """Data sets by kind, in the order of `KINDS`; those of one kind stay in theirs."""
    places = list(KINDS)
    return tuple(sorted(data, key=lambda one: places.index(one.kind)))


def of_role(data: Sequence[DataSet], role: Role) -> list[DataSet]:
    """Data sets of one role."""
    return [one for one in data if one.role is role]
