"""Most likely values, draws, intervals, tests and verdicts of a fit."""
