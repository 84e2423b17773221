"""Plan of the next measurements."""
