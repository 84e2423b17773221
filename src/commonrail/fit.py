"""Parts of a study and of its search, and results of a fit."""

from commonrail.base.public import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
