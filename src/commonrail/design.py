"""Measurements to make next, and effect of parameters."""

from commonrail.base.public import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
