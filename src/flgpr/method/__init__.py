"""The method: the passes of a recipe over the scans of a lane, and what they are made of."""
