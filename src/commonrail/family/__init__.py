"""Injectors of one type: what parts have in common, and the model of a new part from it."""
