"""Optimisers behind one protocol: ask, tell, state."""
