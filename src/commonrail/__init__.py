"""commonrail: simulate and calibrate common-rail electro-injectors.

The public names stand in ``__init__.pyi`` and are loaded when they are first used: importing the package compiles and
reads nothing.
"""

import sys
from typing import Any

import lazy_loader

_load, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    """Load a public name from its module (PEP 562)."""
    if name == "__version__":
        from importlib.metadata import version

        return version("commonrail")
    if name not in __all__ and not name.startswith("_"):
        from commonrail.base.errors import nearest

        raise AttributeError(f"commonrail has no {name}{nearest(name, __all__)}; dir(commonrail) lists what it has.")
    value = _load(name)
    if "ipykernel" in sys.modules:
        from commonrail.base.display import watch

        watch()
    return value
