from flgpr.commands.agree import agree
from flgpr.commands.compare import compare
from flgpr.commands.detect import detect
from flgpr.commands.replay import replay
from flgpr.commands.score import score
from flgpr.commands.train import train
from flgpr.imaging.operator import ImagingOperator
from flgpr.imaging.scan import ScanImager
from flgpr.model.frames import Grid
from flgpr.model.lane import Lane
from flgpr.model.run import make_run
from flgpr.model.sensor import Sensor, load_sensor
from flgpr.notebook import view
from flgpr.recipe.schema import Recipe, load_recipe
from flgpr.results.result import Result, read_result
from flgpr.scoring.lane_roc import roc
from flgpr.simulate.scene.scene import Scene, load_scene
from flgpr.simulate.simulator import simulate
from flgpr.store.lane_file import read_lane
from flgpr.store.run_store import open_run
from flgpr.store.run_writer import save_run
from flgpr.store.sample import sample_lane
from flgpr.store.tables import read_table

__version__: str

__all__ = [
    "Grid",
    "ImagingOperator",
    "Lane",
    "Recipe",
    "Result",
    "ScanImager",
    "Scene",
    "Sensor",
    "__version__",
    "agree",
    "compare",
    "detect",
    "load_recipe",
    "load_scene",
    "load_sensor",
    "make_run",
    "open_run",
    "read_lane",
    "read_result",
    "read_table",
    "replay",
    "roc",
    "sample_lane",
    "save_run",
    "score",
    "simulate",
    "train",
    "view",
]
