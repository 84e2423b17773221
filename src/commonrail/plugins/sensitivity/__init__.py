"""Global sensitivity indices."""
