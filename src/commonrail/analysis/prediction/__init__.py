"""Predictions of a fit with bands: at its data, and at operating points that were not measured."""
