"""Quantity maps, their inverse, sweeps and files for ECUs."""
