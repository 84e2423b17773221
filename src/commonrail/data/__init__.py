"""Measured data: injection curves, quantities, features, meters and noise models."""
