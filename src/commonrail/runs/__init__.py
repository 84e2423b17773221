"""Run folders, journal, resume."""
