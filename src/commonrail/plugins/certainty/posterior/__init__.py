"""Draws from the posterior density."""
