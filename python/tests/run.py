"""Runs pytest on a file; exit code 77 without what the tests need."""

import sys

try:
    import numpy  # noqa: F401
    import pytest
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

# Nothing is written to the source folder.
code = pytest.main(["-q", "-p", "no:cacheprovider", *sys.argv[1:]])
# A file that skips itself as a whole has no tests; pytest prints the reason.
sys.exit(77 if code == pytest.ExitCode.NO_TESTS_COLLECTED else code)
