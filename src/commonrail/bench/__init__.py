"""Time beside accuracy of commonrail's methods on one machine, in one record."""
