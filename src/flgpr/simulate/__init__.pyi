from flgpr.model import Sensor
from flgpr.simulate.gprmax_deck import Decks, make_decks
from flgpr.simulate.scene import Scene, load_scene, sites
from flgpr.simulate.simulator import Simulator, finest_cell, simulate
from flgpr.simulate.world import ALONE, BARE, EVEN, World, draw_world, told

__all__ = [
    "ALONE",
    "BARE",
    "EVEN",
    "Decks",
    "Scene",
    "Sensor",
    "Simulator",
    "World",
    "draw_world",
    "finest_cell",
    "load_scene",
    "make_decks",
    "simulate",
    "sites",
    "told",
]
