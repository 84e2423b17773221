"""commonrail: simulate and calibrate common-rail electro-injectors."""

from importlib.metadata import version

__version__ = version("commonrail")
