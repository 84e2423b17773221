"""How laws become machine code, and the cache of it."""
