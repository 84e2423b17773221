"""Fixtures of other packages that the tests of this folder use."""

from tests.cli.conftest import command, study  # noqa: F401
