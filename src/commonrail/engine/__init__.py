"""Simulation of an injector: operating points, lanes, reference engines, solutions, status."""
