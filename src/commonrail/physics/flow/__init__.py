"""Laws of flow through orifices and gaps, of volumes, pipes and contacts."""
