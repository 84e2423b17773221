"""Simulation in steps of a caller, with inputs that change between them."""
