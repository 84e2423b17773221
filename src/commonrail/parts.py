"""Many parts of one type: tolerances, types, fleets, test plans, diagnosis and trim."""

from commonrail.base.public import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
