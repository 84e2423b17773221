"""Verbs of the core, a module each."""
