"""Imports of a worker at its work, done once for all that are forked; see `tests.workers.forked`."""

from __future__ import annotations

import contextlib

from numba.core.registry import cpu_target

import commonrail.calibration.distributed_objective
import commonrail.calibration.run
import commonrail.engine.simulate
import commonrail.plugins.fleet.member
import commonrail.workers.pool  # noqa: F401

with contextlib.suppress(ImportError):
    import distributed  # noqa: F401

cpu_target.target_context.refresh()
