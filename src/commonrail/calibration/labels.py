"""Labels of models that are compared."""

from __future__ import annotations

from collections.abc import Sequence

from commonrail.errors import ConfigurationError

__all__ = ["MOST_MODELS", "check_labels"]

MOST_MODELS = 8  # colours and markers that can be told apart
# Names that the results give to other things than models.
_RESERVED = frozenset(
    {"data", "dead_time", "measured", "quantity", "synthetic", "time_s"}
    | {"rail_pressure", "cylinder_pressure", "return_pressure", "energising_time"}
)


def check_labels(labels: Sequence[str]) -> None:
    """Refuse no model, too many, and labels that tables and files cannot carry.

    Raises
    ------
    ConfigurationError
        With the label.
    """
    if not 1 <= len(labels) <= MOST_MODELS:
        raise ConfigurationError(f"Between 1 and {MOST_MODELS} models can be compared at a time, not {len(labels)}.")
    for label in labels:
        if label in _RESERVED:
            raise ConfigurationError(f'"{label}" cannot be the label of a model: results use it; choose another one.')
        if not label.strip() or not label.isprintable():
            raise ConfigurationError(f"{label!r} cannot be the label of a model; choose a short printable text.")
