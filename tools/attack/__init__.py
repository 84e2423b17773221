"""Attacks on what is promised in docs/reliability.md: ``python -m tools.attack``, each held or fallen."""
