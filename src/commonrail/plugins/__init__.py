"""Parts that ship with the package, by group (`commonrail.registry.GROUPS`) and name: ``module:object``."""

from __future__ import annotations

SHIPPED: dict[str, dict[str, str]] = {}
