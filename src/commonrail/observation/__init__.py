"""Meters: laws between the flow that leaves the nozzle and the signal that a bench records."""
