"""Fixtures of other packages that the tests of this folder use."""

from tests.cli.conftest import command  # noqa: F401
from tests.plugins.certainty.conftest import as_for_the_user  # noqa: F401
