"""Compilation by numba: compiled code on disk that copies share, and work that threads share."""
