"""Injector models: catalogue, parts, parameters, and export to files, pages and linear models."""

from commonrail.base.public import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
