"""Features of injections as measured data: delays, ramps, rates and quantities, each against its tolerance."""
