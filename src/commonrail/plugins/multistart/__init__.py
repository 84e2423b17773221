"""Optimiser: damped least squares from many starts."""
