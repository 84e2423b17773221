"""Test plans of workshops: an injector judged by nominal quantities with bands."""
