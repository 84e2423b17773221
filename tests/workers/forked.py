"""Workers that are forked from a process that has imported what they need, in place of starting Python for each.

For tests of what is done with workers; those of how workers start, and of what they take from the environment, start
them as the program does.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from commonrail.workers.pool import shield_children

METHOD = "forkserver"
IMPORTED = ["tests.workers.imported"]


@contextmanager
def forked() -> Iterator[None]:
    """Workers that are started inside, also those of a cluster on this machine, are forked."""
    if METHOD not in multiprocessing.get_all_start_methods():
        yield
        return
    from multiprocessing.forkserver import ensure_running, set_forkserver_preload

    set_forkserver_preload(IMPORTED)
    with shield_children():
        ensure_running()
    context = multiprocessing.get_context(METHOD)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("commonrail.workers.pool.get_context", lambda _: context)
        try:
            import dask
            import distributed.utils
        except ImportError:
            yield
            return
        # Dask would import whatever it finds, and name it to the process that forks, which has begun
        patch.setattr(distributed.utils, "_forkserver_preload_set", True, raising=False)
        with dask.config.set({"distributed.worker.multiprocessing-method": METHOD}):
            yield
