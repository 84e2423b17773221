"""Several injectors of one type fitted together, and a type adapted to a part."""
