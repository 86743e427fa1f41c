"""Runs as Compensated Phase History Data and back."""
