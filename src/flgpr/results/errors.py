"""What reading a result folder raises."""


class ResultError(ValueError):
    """A result folder is incomplete, altered or not a result folder at all."""
