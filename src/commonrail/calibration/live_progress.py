"""Bar of a calibration in a notebook."""

from __future__ import annotations

from collections.abc import Callable

from commonrail.calibration.search import Progress
from commonrail.display.live import Live, in_notebook

__all__ = ["live_progress"]


def live_progress() -> Callable[[Progress], None] | None:
    """Listener that draws a bar in a notebook's output; None elsewhere."""
    if not in_notebook():
        return None
    live = Live()

    def show(p: Progress) -> None:
        live.show(f"{p.phase}: best {p.best:.4g}, mean {p.mean:.4g}, {p.seconds:.0f} s", p.generation, p.generations)

    return show
