"""The command `commonrail`."""
