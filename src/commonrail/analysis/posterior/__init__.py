"""Posterior of a fit: draws of the parameters given data, noise and priors, with a test of whether they can be used."""
