"""Recordings in SigMF, read and written."""
