"""Reading of TOML, columns and texts from disk: types, places and limits, nothing of injectors or studies."""
