"""Tolerance studies: spread of the injected quantity over parts whose dimensions scatter within their tolerances."""
