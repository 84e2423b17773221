"""Injection curves."""
