"""Files for the tests of reading."""

from tests.files.conftest import table_file

__all__ = ["table_file"]
