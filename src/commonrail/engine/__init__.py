"""Simulation of an injector: operating points, lanes, reference engines, stepper, solutions, status."""
