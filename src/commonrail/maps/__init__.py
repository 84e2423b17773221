"""Quantity maps of an injector, their inverse, and sweeps of operating points."""
