"""Parts of the report of a fit."""
