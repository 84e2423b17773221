"""Quantity maps: measured quantities per stroke at many operating points, and dead times."""
