"""Tables of a calibration or a validation: the terminal prints them and the report sets them."""

from __future__ import annotations

from collections.abc import Sequence

from commonrail.display.table import Table
from commonrail.kinds.records import LABELS, Record, Texts
from commonrail.report.record import by_kind

__all__ = ["tables_of"]


def tables_of(data: Sequence[Record], texts: Texts = LABELS) -> list[Table]:
    """Every table that the data sets of a result, or of a validation, have something for.

    Errors and shares are those of the label "best", whatever its text.
    """
    return [table for view, own in by_kind(data) for table in view.tables(own, texts)]
