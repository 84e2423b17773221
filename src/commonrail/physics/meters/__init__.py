"""Meters, which stand between the injection and what is recorded."""
