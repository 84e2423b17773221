"""Injectors as C libraries, FMUs and sources."""
