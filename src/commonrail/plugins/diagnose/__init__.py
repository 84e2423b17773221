"""Diagnosis: which single fault explains what a bench measured, and trim of a sound part from a few tests."""
