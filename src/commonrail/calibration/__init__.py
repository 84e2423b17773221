"""Study, parameters, objective, optimisers, search, plausibility."""
