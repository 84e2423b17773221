"""An injector that its caller steps, and its linear model: for control design and co-simulation."""
