"""Bands are compared with those of a fit as the user has it."""

from tests.plugins.certainty.conftest import as_for_the_user  # noqa: F401
