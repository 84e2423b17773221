"""Benchmarks: time and accuracy in one run, with peers beside commonrail."""
