"""Comparison of injectors on any data, without fitting."""
