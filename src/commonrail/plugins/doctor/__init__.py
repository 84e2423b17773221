"""Facts about this machine, and whether commonrail works on it."""
