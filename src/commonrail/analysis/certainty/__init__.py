"""Certainty of a fit: likelihood, intervals, profiles, tests for lack of fit, and verdicts in words."""
