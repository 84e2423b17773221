"""Machine code from laws, and the cache of it."""
