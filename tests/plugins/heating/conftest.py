"""Fixtures of other packages that the tests of this folder use."""

from tests.cli.conftest import command  # noqa: F401
