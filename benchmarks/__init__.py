"""Parts of ``make bench`` alone: other solvers and optimisers, cost curves, rooflines, figures."""
