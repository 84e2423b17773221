"""Intervals, verdicts and posterior of a fit."""
