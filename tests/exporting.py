"""Platform for which tests export, where this machine has one and a compiler for it."""

from __future__ import annotations

import pytest

from commonrail.base.errors import ConfigurationError
from commonrail.plugins.export.object_files import compiler_for, find_target, own_platform


def usable_platform() -> str:
    """Name of this machine's platform; the test is skipped where there is none, or no compiler."""
    names = own_platform()
    if not names:
        pytest.skip("this machine runs none of the platforms that are exported to")
    try:
        compiler_for(find_target(names[0]))
    except ConfigurationError as error:
        pytest.skip(str(error))
    return names[0]
