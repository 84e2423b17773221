"""Scatter of a series within tolerances."""
