"""Checks of the program, and the paper's study on a virtual test bench."""

from commonrail.base.public import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
