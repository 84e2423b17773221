"""Injector stepped by its caller, and its linear model: for control design and co-simulation."""
