"""Errors that a user can mend; their text is all that is shown."""


class BenchmarkError(Exception):
    """Unusable data, experiment or program."""
