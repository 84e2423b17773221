"""What a calibrated model is worth, and what it is good for."""
