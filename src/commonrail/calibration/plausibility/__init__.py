"""Findings on a study before and after its fit."""
