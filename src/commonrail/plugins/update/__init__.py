"""Update of a calibrated run with new data."""
