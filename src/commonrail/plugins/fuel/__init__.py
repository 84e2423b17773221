"""Fuels fitted to tables of measured properties."""
