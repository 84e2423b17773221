"""Files in and out: injectors and studies from TOML, measured columns from CSV, and the run folder."""
