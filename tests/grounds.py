"""Small proving grounds of tests, and what is asked of their folders."""

from flgpr.trials import read_register
from flgpr_ground.lanes import SEALED
from systems.lanes import SENSOR

RULES = """\
halo = 1.0
fars = [0.02, 0.1]
far = 0.1
"""
TRACK = """\
[scene.surface]
density = 4.0
[scene.track]
start = -6.0
step = [2.0, 2.2]
"""
SMOOTH = """\
[tiers.smooth]
title = "a lane that was rolled"
[tiers.smooth.sites]
sand = "prepared-sand"
"""
ROUGH = """\
[tiers.rough]
title = "a lane as found"
[tiers.rough.sites]
sand = "arid-sand"
"""
SORTS = """\
[sorts]
metal = { kind = "metal" }
pmn = { kind = "ap", body = "pmn" }
"""
TINY = (
    """\
name = "tiny"
version = 3
sensor = "sri-array"
"""
    + RULES
    + """\
reference = "wang2007"
[scene]
x_min = -1.5
x_max = 1.5
[scene.surface]
density = 2.0
"""
    + SMOOTH
    + ROUGH
    + SORTS
    + """\
[lanes.known]
part = "train"
length = 12.0
targets = [["metal", -0.15, 2]]
[lanes.test]
part = "test"
length = 40.0
targets = [["metal", -0.15, 6], ["pmn", 0.01, 2]]
[lanes.bare]
part = "test"
length = 12.0
targets = []
[splits.standard]
title = "all"
folds = [{ train = ["*-known-*"], test = ["*-test-*", "*-bare-*"] }]
[splits.metal]
title = "metal alone"
folds = [{ train = ["*-known-*"], test = ["*-test-*"] }]
kinds = ["metal"]
"""
)
"""With tiers; submissions enter it without lanes."""
SMALL = (
    """\
name = "small"
version = 3
sensor = "{sensor}"
"""
    + RULES
    + """\
reference = "one"
"""
    + TRACK
    + """\
[sites]
arid = "arid-sand"
gravel = "gravel"
"""
    + SORTS
    + """\
[lanes.known]
part = "train"
length = 24.0
targets = [["metal", -0.15, 5]]
[lanes.test]
part = "test"
length = 24.0
targets = [["metal", -0.15, 4], ["pmn", 0.01, 1]]
[lanes.bare]
part = "test"
length = 24.0
targets = []
[splits.standard]
title = "all"
folds = [{ train = ["*-known-*"], test = ["*-test-*"] }]
[splits.new-site]
title = "another site"
folds = [
    { train = ["gravel-known-*"], test = ["arid-test-*"] },
    { train = ["arid-known-*"], test = ["gravel-test-*"] },
]
"""
)
"""Without tiers; detectors run on it in seconds. ``{sensor}`` stands for a file."""
TIERED = (
    """\
name = "tiers"
version = 1
sensor = "{sensor}"
"""
    + RULES
    + """\
reference = "one"
"""
    + TRACK
    + SMOOTH
    + """\
[tiers.smooth.surface.known]
unevenness = 128e-6
"""
    + ROUGH
    + SORTS
    + """\
vs-1-6 = { kind = "plastic", body = "vs-1.6" }
simulant = { kind = "simulant" }
[lanes.known]
part = "train"
length = 18.0
targets = [["metal", -0.15, 4]]
[lanes.test]
part = "test"
length = 24.0
targets = [["metal", -0.15, 2], ["pmn", 0.01, 1], ["vs-1-6", 0.05, 1], ["simulant", 0.05, 1]]
[lanes.bare]
part = "test"
length = 18.0
targets = []
[splits.standard]
title = "all"
folds = [{ train = ["sand-known-*"], test = ["sand-test-*", "*-bare-*"] }]
"""
)
"""With tiers; detectors run on it in seconds. ``{sensor}`` stands for a file."""


def write_runnable_ground(folder, text):
    """Write a ground that detectors run on, with its sensor, and return its file."""
    (folder / "sensor.toml").write_text(SENSOR)
    path = folder / "ground.toml"
    path.write_text(text.replace("{sensor}", str(folder / "sensor.toml")))
    return path


def looks(out):
    """Return the events in the log of looks at the sealed truth of a folder."""
    return [line["event"] for line in read_register(f"{out / 'lanes' / SEALED}.log.jsonl")]
