"""What only ``make bench`` needs: other solvers and optimisers, cost curves, rooflines, figures."""
