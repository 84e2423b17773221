"""Units, quantities, arguments, errors, text and the registry of parts: what every other package uses."""
