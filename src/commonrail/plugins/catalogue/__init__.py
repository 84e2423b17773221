"""Lists and gallery of fuels, injectors, meters, features and parameters."""
