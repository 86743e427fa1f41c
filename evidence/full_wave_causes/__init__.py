"""Lanes, experiments and tables of `why_full_wave.py`."""
