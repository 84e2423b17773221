"""Design of the next measurement: operating points that would tell most, averaged over what the data leave open."""
