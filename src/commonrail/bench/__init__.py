"""Facts of the machine for `commonrail doctor`."""
