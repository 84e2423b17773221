"""Attacks on what is promised in docs/reliability.md: ``python -m tests.robustness.attack``, each held or fallen."""
