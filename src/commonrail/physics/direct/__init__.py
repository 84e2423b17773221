"""Injector whose solenoid acts on the needle itself."""
