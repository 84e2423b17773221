"""Rate of injection as a boundary condition of flow simulations (CFD)."""
