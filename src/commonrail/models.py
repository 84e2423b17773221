"""Catalogue, parts and parameters of injectors; what becomes of a model: files, pages, linear models."""

from commonrail.base.public import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
