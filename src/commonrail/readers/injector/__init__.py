"""Files of injectors and of their catalogue."""
