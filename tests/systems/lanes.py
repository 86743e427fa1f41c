"""Simulated lanes for the tests of whole systems: a small array, and the packaged recipes cut down to it."""

from pathlib import Path

from flgpr.commands.simulate import simulate_lane
from flgpr.recipe.schema import recipe_text
from flgpr.store import open_run, save_run
from small_lane import cut_down

LENGTH = 30.0
SENSOR = """name = "small"
source = "a small array for tests"
polarization = ["HH", "VV", "HV", "VH"]
height = 2.5
tilt = 0.26
footprint = [-4.0, 4.0, 2.5, 10.0]
specular_echo = false
direct_wave = false

[tones]
start = 0.6e9
step = 14e6
count = 81

[tx]
first = [-0.9, 0.0, 0.0]
last = [0.9, 0.0, 0.0]
count = 2

[rx]
first = [-1.1, 0.0, 0.0]
last = [1.1, 0.0, 0.0]
count = 4

[antenna]
kind = "horn"
"""
SCENE = """name = "lane"
site = "arid-sand"
x_min = -1.5
x_max = 1.5
length = {length}
[surface]
density = 4.0
[clutter]
bushes = 0.25
posts = 0.05
rocks = 0.02
roadside = [2.0, 3.5]
[[draws]]
kind = "metal"
depth = -0.15
count = 9
[[draws]]
kind = "metal"
depth = 0.0
count = 5
[track]
start = -6.0
step = [1.4, 1.6]
wander = 0.05
"""
# What stands in a packaged recipe, and what the small array takes in its place.
SUMMED = ("spacing = 0.05\nframes = 5 ", "spacing = 0.1\nframes = 2 ")
SMALL = {
    "cosgrove2004": [
        ("x = [-2.5, 2.5]\ny = [12.0, 18.0]", "x = [-1.6, 1.6]\ny = [4.0, 8.0]"),
        ("spacing = [0.05, 0.02]", "spacing = [0.1, 0.05]"),
        ("band = [0.3e9, 1.9e9]", "band = [0.6e9, 1.7e9]"),
        ("length = 28", "length = 10"),
        ("clutter_step = [7, 8]", "clutter_step = [5, 8]"),
        (
            "x = [-2.5, 2.5]\nspacing = 0.05\ny_max = 18.0",
            "x = [-1.6, 1.6]\nspacing = 0.1\ny_max = 8.0",
        ),
        ("size = 25\nspacing = 0.05", "size = 13\nspacing = 0.1"),
    ],
    "flsar2004": [
        ("x = [-3.0, 3.0]           #", "x = [-2.4, 2.4]  #"),
        ("y = [8.0, 22.0]", "y = [3.5, 8.5]"),
        ("spacing = [0.08, 0.03]", "spacing = [0.1, 0.05]"),
        ("band = [0.3e9, 3.0e9]", "band = [0.6e9, 1.7e9]"),
        (
            "x = [-3.0, 3.0]\nspacing = 0.05\ny_max = 22.0",
            "x = [-2.4, 2.4]\nspacing = 0.1\ny_max = 8.5",
        ),
        ("ranges = [10.0, 15.0, 20.0]\nwithin = 2.5", "ranges = [4.5, 6.0, 7.5]\nwithin = 0.75"),
        ('rule = "and-or"', 'rule = "or"'),
        ("share = 0.1  ", "share = 0.3  "),
        ("share = 0.1\n", "share = 0.3\n"),
        ('subband = "10 m"', 'subband = "4.5 m"'),
        ("size = 25\nspacing = 0.05", "size = 13\nspacing = 0.1"),
    ],
    "fuse2018-printed": [
        ("x = [-10.0, 10.0] ", "x = [-3.6, 3.6] "),
        ("y = [5.0, 15.0] ", "y = [3.5, 7.6] "),
        SUMMED,
        ("L = [0.75e9, 3.2e9]", "L = [0.6e9, 1.7e9]"),
        ("edges = [5.0, 7.5, 10.0, 12.5, 15.0]", "edges = [3.5, 5.0, 8.0]"),
        ("frames = 5\n", "frames = 2\n"),
        ("roadside = [4.0, 10.0]", "roadside = [1.9, 3.6]"),
        ("iterations = 7", "iterations = 2"),
        ("combination = 6", "combination = 1"),
        ("within = 4.0", "within = 1.8"),
        ("x = [-7.0, 7.0] ", "x = [-2.0, 2.0] "),
        ("spacing = 0.05\ny_max = 10.0", "spacing = 0.1\ny_max = 7.0"),
        ("size = 25\nspacing = 0.05", "size = 13\nspacing = 0.1"),
    ],
    "wang2007": [
        ("x = [-6.0, 6.0]", "x = [-2.4, 2.4]"),
        ("y = [7.0, 26.0]", "y = [3.5, 8.5]"),
        ("spacing = 0.05", "spacing = 0.1"),
        ("F0 = [0.80e9, 2.80e9]\n", ""),
        ("F1 = [0.75e9, 1.35e9]", "F1 = [0.6e9, 1.2e9]"),
        (
            "F2 = [1.25e9, 1.85e9]\nF3 = [1.75e9, 2.35e9]\nF4 = [2.25e9, 2.85e9]",
            "F2 = [1.1e9, 1.7e9]",
        ),
        ("x = [-3.0, 3.0]", "x = [-2.0, 2.0]"),
        ("y_max = 16.0", "y_max = 7.0"),
    ],
}
SMALL["wang2007-printed"] = SMALL["wang2007"]
SMALL["fuse2018"] = [
    ("spacing = 0.05\nframes = 1 ", "spacing = 0.1\nframes = 1 ") if change == SUMMED else change
    for change in SMALL["fuse2018-printed"]
]
SMALL["fused"] = [
    ("x = [-6.0, 6.0]", "x = [-2.4, 2.4]"),
    ("y = [7.0, 26.0]", "y = [3.5, 8.5]"),
    ("spacing = 0.05", "spacing = 0.1"),
    ("B0 = [0.45e9, 0.60e9]\n", ""),
    ('"sri-array"', '"SENSOR"'),
    ('kinds = ["metal"]', 'kinds = ["metal"]\ncopies = 4'),
    ("x = [-3.0, 3.0]", "x = [-2.0, 2.0]"),
    ("y_max = 16.0", "y_max = 7.0"),
]
SMALL["fused3"] = SMALL["fused"]
SMALL["fuse2018-wang2007"] = [
    ("edges = [7.0, 10.0, 13.0, 17.0, 22.0]", "edges = [3.5, 5.0, 8.0]"),
    (
        "x = [-6.0, 6.0]\ny = [7.0, 22.0]\nspacing = 0.1",
        "x = [-3.6, 3.6]\ny = [3.5, 8.0]\nspacing = 0.1",
    ),
    ("frames = 3", "frames = 2"),
    ("roadside = [2.5, 6.0]", "roadside = [1.9, 3.6]"),
    ("iterations = 7", "iterations = 2"),
    ("combination = 6", "combination = 1"),
    *SMALL["wang2007"],
]
LANE = "x_min = -1.5\nx_max = 1.5\ny_min = 0.0\ny_max = 30.0\n"


def small_recipe(name: str) -> str:
    """Text of a packaged recipe, cut down to the small array."""
    return cut_down(recipe_text(name), SMALL[name])


def make_lanes(folder: Path) -> None:
    """Simulate a lane to train on and one to test on; write the second band, the lane and the recipes beside them."""
    (folder / "sensor.toml").write_text(SENSOR)
    (folder / "lane.toml").write_text(LANE)
    for name in SMALL:
        (folder / f"{name}.toml").write_text(
            small_recipe(name).replace("SENSOR", str(folder / "sensor.toml"))
        )
    for seed, (name, length) in enumerate((("train", 36.0), ("test", LENGTH)), 1):
        scene = folder / f"scene-{name}.toml"
        scene.write_text(SCENE.format(length=length))
        simulate_lane(
            scene,
            sensor=folder / "sensor.toml",
            seed=seed,
            output=folder / f"{name}.zarr",
            errors=False,
            truth=folder / f"{name}.csv",
        )
        # The upper half of the band as a radar of its own: what matters here is where its data come
        # from.
        run = open_run(folder / f"{name}.zarr").sel(
            polarization=["VV"], frequency=slice(1.2e9, None)
        )
        save_run(run, folder / f"{name}-x.zarr")
