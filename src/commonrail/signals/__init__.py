"""Features of rates of injection: delays, instants, ramps, rates and quantities, measured or simulated alike."""
