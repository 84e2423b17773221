"""Calibration of a foreign FMU."""
