"""Injectors beside one another on any data, without fitting."""
