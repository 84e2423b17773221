"""Measured data in reports."""
