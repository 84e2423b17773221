"""Prediction bands."""
