"""Figures of the benchmark; the benchmark itself is `commonrail bench`."""
