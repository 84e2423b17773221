"""Foreign FMUs as models: their parameters calibrated to measured curves and values."""
