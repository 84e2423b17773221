"""Sensitivity studies: effect of parameters on J, on quantities and on the features of an injection."""
