"""commonrail: simulate and calibrate common-rail electro-injectors.

The public names stand in ``__init__.pyi``, those of a namespace in the stub of its module, and are loaded when they are
first used: importing the package compiles and reads nothing else.
"""

import sys
from importlib import import_module
from typing import Any

from commonrail.base.public import attach

_load, __dir__, __all__ = attach(__name__, __file__)


def __getattr__(name: str) -> Any:
    """Load a public name from its module (PEP 562)."""
    if name == "__version__":
        from importlib.metadata import version

        return version("commonrail")
    value = _load(name)
    _prepare_notebooks()
    return value


def _prepare_notebooks() -> None:
    """Give results of the physics their tables and figures, and say in a notebook when a kernel is compiled."""
    import_module("commonrail.base.display").lend()
    if "ipykernel" in sys.modules:
        import_module("commonrail.base.display").watch()
