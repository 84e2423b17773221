"""Fixtures of other packages that the tests of this folder use."""

from tests.cli.conftest import command, study  # noqa: F401
from tests.readers.conftest import injector_file, study_file  # noqa: F401
