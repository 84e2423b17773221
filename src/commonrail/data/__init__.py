"""What was measured: injection curves, quantities, features, meters and noise models."""
