"""Features of measured traces on the command line."""
