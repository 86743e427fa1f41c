"""The map of worlds.

What a lane must be like for mines to be found and for the papers' statements to hold.
"""

from flgpr_papers.worlds.parts import PARTS, map_worlds

__all__ = ["PARTS", "map_worlds"]
