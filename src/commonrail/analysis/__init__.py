"""Worth of a calibrated model: identifiability, verification, the virtual test bench, searches over seeds."""
