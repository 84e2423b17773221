"""commonrail: simulate and calibrate common-rail electro-injectors.

The public names stand in ``__init__.pyi``, those of a namespace in the stub of its module, and are loaded when they are
first used: importing the package compiles and reads nothing else.
"""

import sys
from typing import Any

from commonrail.base.public import attach

_load, __dir__, __all__ = attach(__name__, __file__)


def __getattr__(name: str) -> Any:
    """Load a public name from its module (PEP 562)."""
    if name == "__version__":
        from importlib.metadata import version

        return version("commonrail")
    value = _load(name)
    if "ipykernel" in sys.modules:
        from commonrail.base.display import watch

        watch()
    return value
