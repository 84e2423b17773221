"""Components of an injector: parameters, coefficients, states and laws of each."""
