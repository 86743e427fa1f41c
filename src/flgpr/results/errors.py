"""Errors of reading a result folder."""


class ResultError(ValueError):
    """A result folder is incomplete, altered or not a result folder at all."""
