"""Features of measured and simulated traces: delays, ramps, rates, quantities."""

from commonrail.base.public import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
