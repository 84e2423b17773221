"""Wait for what happens in another thread or process."""

from __future__ import annotations

import time
from collections.abc import Callable

# Ends a hang [s]. What is waited for comes within seconds, and on a machine with other work within a few times that.
PATIENCE = 600.0


def wait_until(happened: Callable[[], object], what: str) -> None:
    """Return once `happened` is true.

    Parameters
    ----------
    happened : function
    what : str
        End of the sentence of failure "It did not come that …".

    Raises
    ------
    AssertionError
        If it has not happened within `PATIENCE`.
    """
    start = time.monotonic()
    while not happened():
        assert time.monotonic() - start < PATIENCE, f"It did not come that {what}."
        time.sleep(0.01)
