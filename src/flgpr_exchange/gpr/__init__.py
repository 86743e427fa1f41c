"""Recordings of commercial ground-penetrating radars: lines of traces, placed and made runs."""
