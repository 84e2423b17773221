"""Time, accuracy and search of commonrail compared with other solvers and optimisers; rooflines and figures."""
