"""The liquid: density, bulk modulus, viscosity and wave speed (Eq. 2), for host and hot loop."""
