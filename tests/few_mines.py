"""A lane with three mines, the packaged recipes at the size of a small array, and following what an error advises."""

import re
from pathlib import Path

from flgpr.commands.simulate import simulate_lane
from flgpr.recipe.schema import recipe_text
from small_lane import cut_down
from systems.lanes import SENSOR, SMALL

MINES = ((-0.7, 6.0), (0.6, 15.0), (0.1, 24.0))
LANE = "x_min = -1.5\nx_max = 1.5\ny_min = 0.0\ny_max = 30.0\n"
SCENE = """name = "three mines"
site = "arid-sand"
x_min = -1.5
x_max = 1.5
length = 30.0
[surface]
density = 3.0
[clutter]
bushes = 0.25
posts = 0.05
rocks = 0.02
roadside = [2.0, 3.5]
[track]
start = -6.0
step = [1.4, 1.6]
wander = 0.05
""" + "".join(f'[[targets]]\nkind = "metal"\nx = {x}\ny = {y}\ndepth = -0.15\n' for x, y in MINES)
# What the other tests of whole systems change beside the geometry; here it stays as packaged.
_PACKAGED = ("rule", "share", "n_starts", "iterations", "combination", "band =", "L =", "F", "B")
_MINIATURE = [
    ("y = [1.2, 5.84]", "y = [2.5, 7.14]"),
    ("y_max = 5.84", "y_max = 7.14"),
    ("spacing = 0.025", "spacing = 0.05"),
]
_ADVICE = re.compile(r"(\w+) = ([^()]+) in (\[\[?[\w.]+\]\]?)(?: of stage (\"[\w-]+\"))? \(now ")


def make_lane(folder: Path) -> None:
    """Simulate the lane with all tones that the packaged sub-bands need."""
    sensor = cut_down(
        SENSOR,
        [
            ("start = 0.6e9", "start = 0.3e9"),
            ("step = 14e6", "step = 13e6"),
            ("count = 81", "count = 224"),
        ],
    )
    (folder / "sensor.toml").write_text(sensor)
    (folder / "scene.toml").write_text(SCENE)
    (folder / "lane.toml").write_text(LANE)
    run = folder / "run.zarr"
    truth = folder / "truth.csv"
    simulate_lane(
        folder / "scene.toml",
        sensor=folder / "sensor.toml",
        seed=1,
        output=run,
        errors=False,
        truth=truth,
    )


def resized(name: str, folder: Path) -> str:
    """Text of a packaged recipe whose lengths alone fit the small array."""
    changes = [
        (old, new) for old, new in SMALL.get(name, _MINIATURE) if not old.startswith(_PACKAGED)
    ]
    text = cut_down(recipe_text(name), changes).replace("SENSOR", str(folder / "sensor.toml"))
    return text.replace("copies = 4", "copies = 2")


def counts_of(message: str) -> dict[str, int]:
    """What each step left, as a message counts it."""
    listed = re.split(r"\. (?=Set |Give )", message.partition("Step by step: ")[2])[0]
    pairs = [one.rpartition(": ") for one in listed.split("; ")]
    return {what: int(number) for what, _, number in pairs}


def follow(text: str, message: str) -> str:
    """Change a recipe's entry as the first advice of a message says."""
    advice = _ADVICE.search(message.partition("Set ")[2])
    assert advice, message
    key, value, header, stage = advice.groups()
    tables = re.split(r"^(?=\[)", text, flags=re.MULTILINE)
    wanted = [
        n
        for n, one in enumerate(tables)
        if one.startswith(header) and (not stage or f"stage = {stage}" in one)
    ]
    assert len(wanted) == 1, (header, stage)
    table = tables[wanted[0]]
    entry = f"{key} = {value}"
    table, found = re.subn(rf"^{key} = .*$", lambda _: entry, table, flags=re.MULTILINE)
    tables[wanted[0]] = table if found else table.replace("\n", f"\n{entry}\n", 1)
    return "".join(tables)
