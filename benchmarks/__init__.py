"""Time, accuracy and search of commonrail beside other solvers and optimisers; rooflines and figures."""
