"""The map of worlds: on which lanes mines are found and the papers' statements hold."""

from flgpr_papers.worlds.parts import PARTS, map_worlds

__all__ = ["PARTS", "map_worlds"]
