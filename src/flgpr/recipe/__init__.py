"""Recipes: what they may hold, reading and writing them, and one made for a run."""
