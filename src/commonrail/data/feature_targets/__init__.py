"""Features of an injection as data of a study."""
