"""Quantities over rail pressure and energising time, and return quantities."""
