"""Bodies: signatures of buried targets, rims, and the echoes of single objects."""
