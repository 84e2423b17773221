"""Openings, closings and quantities found in a rate or another trace."""
