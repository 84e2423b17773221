"""Measured data: injection curves, quantities, features, meters and noise models."""

from commonrail.base.public import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
