"""Heating of the fuel on its way through an injector, estimated beside a simulation."""
