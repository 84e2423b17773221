"""Runs that survive: the journal of what was done so far, its lock, copies of all that a study reads."""
