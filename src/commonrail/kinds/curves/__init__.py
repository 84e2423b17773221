"""Injection curves (EVI): measured rate of injection at one operating point."""
