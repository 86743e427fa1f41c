"""Whether a trained recipe finds as many mines as the contrast, on twins of an array's lanes.

A recipe that is fitted to an array may suit it badly, which no training shows. On simulated lanes
of the same array the truth is known, so no mine of the user's is needed.

Twins of a user's lanes: short simulated lanes as an array sees them, with mines far apart.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd
import xarray as xr

from flgpr.method.method import detect
from flgpr.method.model import Model
from flgpr.method.model_check import CHECK_FILE, Check, write_check
from flgpr.model import Lane, Sensor, load_sensor
from flgpr.model.motion import plausible_run
from flgpr.model.run_sensor import sensor_of_run
from flgpr.progress import Track, silent
from flgpr.recipe.make import filled_ground, fit_recipe, with_ground_below
from flgpr.recipe.radar_setup import radar_setup
from flgpr.recipe.schema import Recipe, parse_recipe
from flgpr.scoring import Match, match, side_by_side
from flgpr.simulate import Scene, Simulator
from flgpr.stages.body_signatures import OWN_ARRAY

# What lies in the lanes, by turns: body, kind and cover of its top, m.
_MINES = (
    ("metal-at", "metal", 0.03),
    ("tm-62p", "plastic", 0.05),
    ("metal-at", "metal", 0.1),
    ("plastic-at", "plastic", 0.03),
)
APART = 2.0
"""Least distance of two mines, m."""
_SLOT = 2.1  # m of lane for a mine at least
_ROOMY_SLOT = 2.4  # m of lane for a mine where the lane may be as long as it likes
_MINES_A_LANE = 6
_HALF_LANE = 1.5  # m
_EDGE = (
    0.3  # m from a mine to the lane's border at least, and from the lane to that of the run-view
)
_ROUGHNESS = (0.006, 0.009)  # rms height, m, by turns
_CORRELATION = 0.1  # m
_ROCKS = 0.2  # per m²
_LOOKS = 10  # at a place at most
_POSITION = (0.9, 1.1)  # of a step: scans are not quite evenly apart


@dataclass(frozen=True)
class Twin:
    """A simulated lane in memory."""

    name: str
    run: xr.Dataset
    lane: Lane
    truth: pd.DataFrame


@dataclass(frozen=True)
class TwinPlan:
    """How twins of an array's lanes are laid out."""

    sensor: Sensor  #: sees them
    middle: float  #: x of their middle, m
    half: float  #: half their width, m
    length: float  #: m
    mines: int  #: in each
    positions: tuple[float, ...] | None  #: of the scans along the lane, m; None for a drive
    start: float  #: first position of a drive, m
    stop: float  #: last position of a drive, m
    step: float  #: of a drive, m
    soils: tuple[tuple[float, float], ...]  #: permittivity and loss tangent, by turns


def plan_twins(
    run: xr.Dataset, recipe: Recipe, echoes: bool | Literal["auto"] = "auto"
) -> TwinPlan:
    """Lay out twins of the lanes that an array sees with a recipe of simulated signatures.

    Parameters
    ----------
    run : xarray.Dataset
        A run of the array.
    recipe : Recipe
        The recipe, with a map of simulated signatures.
    echoes : bool or "auto"
        Whether twins have the echo of the ground below the array and the direct wave; "auto" gives
        them to low arrays.

    Raises
    ------
    ValueError
        If the recipe has no such map, the tones lie on no even raster, or no lane is long enough to
        hold a mine.
    """
    settings = recipe.map_settings
    if not hasattr(settings, "antennas"):
        raise ValueError(f"recipe must have a map of simulated signatures, got {recipe.name}")
    run = plausible_run(run)
    setup = radar_setup(run)
    base = load_sensor(settings.antennas if settings.sensor == OWN_ARRAY else settings.sensor)
    base = base.model_copy(update={"specular_echo": echoes, "direct_wave": echoes})
    filled = filled_ground(recipe.image.x, recipe.image.y, setup.height)
    sensor = sensor_of_run(run, base, filled)
    if sensor.has_specular_echo:
        sensor = with_ground_below(sensor, filled)
    left, right = recipe.run_view.x
    near = recipe.image.y[0]
    far = min(recipe.image.y[1], recipe.run_view.y_max)
    driven = setup.poses[:, 1] - setup.poses[:, 1].min()
    length = _MINES_A_LANE * _ROOMY_SLOT
    positions = None
    if not setup.drives:
        # The last stop sees the lane's beginning; its end is what the first one sees.
        positions = tuple(float(y) for y in np.sort(driven) - driven.max() - near)
        length = min(length, far - near - float(driven.max()))
    mines = min(int(length / _SLOT), _MINES_A_LANE)
    if not mines:
        raise ValueError(
            f"a lane of {length:.2g} m that all scans see is too short for a mine, which takes "
            f"{_SLOT:g} m"
        )
    steps = np.diff(np.sort(driven))
    own_step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    # Neither the driest nor the wettest soil, if there are others.
    ordered = tuple(sorted(settings.soils))
    return TwinPlan(
        sensor=sensor,
        middle=(left + right) / 2,
        half=min(_HALF_LANE, (right - left) / 2 - _EDGE),
        length=length,
        mines=mines,
        positions=positions,
        start=-far,
        stop=length - near,
        step=max(own_step, (far - near) / _LOOKS),
        soils=(ordered[1:-1] or ordered),
    )


def draw_scene(plan: TwinPlan, number: int, seed: int) -> Scene:
    """Draw the scene of a twin.

    Parameters
    ----------
    plan : TwinPlan
        How twins are laid out.
    number : int
        Number of the twin, from 0 on; soils, roughness and mines go by turns.
    seed : int
        Of all twins.
    """
    rng = np.random.default_rng([seed, number])
    targets = []
    slot = plan.length / plan.mines
    jitter = min((slot - APART) / 2, slot / 2 - _EDGE)
    for place in range(plan.mines):
        body, kind, cover = _MINES[(number * plan.mines + place) % len(_MINES)]
        across = rng.uniform(_EDGE - plan.half, plan.half - _EDGE)
        along = (place + 0.5) * slot + rng.uniform(-jitter, jitter)
        x = plan.middle + across
        targets.append({"kind": kind, "body": body, "x": x, "y": along, "depth": cover})
    permittivity, loss_tangent = plan.soils[number % len(plan.soils)]
    soil = {"model": "fixed", "permittivity": permittivity, "loss_tangent": loss_tangent}
    rms = _ROUGHNESS[(number // len(plan.soils)) % len(_ROUGHNESS)]
    least, most = _POSITION
    track = {"start": plan.start, "stop": plan.stop, "step": (least * plan.step, most * plan.step)}
    if plan.positions is not None:
        track = {"positions": plan.positions}
    return Scene.model_validate(
        {
            "name": f"twin-{number}",
            "x_min": plan.middle - plan.half,
            "x_max": plan.middle + plan.half,
            "length": plan.length,
            "soil": soil,
            "surface": {"rms_height": rms, "correlation_length": _CORRELATION},
            "clutter": {"rocks": _ROCKS},
            "track": track,
            "targets": targets,
        }
    )


def simulate_twin(plan: TwinPlan, number: int, seed: int) -> Twin:
    """Simulate a twin, see :func:`draw_scene`."""
    scene = draw_scene(plan, number, seed)
    # The world of a twin has a seed of its own: those of two seeds of twins never meet.
    world_seed = int(np.random.SeedSequence([seed, number]).generate_state(1)[0])
    simulator = Simulator(scene, plan.sensor, world_seed)
    return Twin(scene.name, simulator.run(), scene.lane, simulator.truth)


def twins_for(plan: TwinPlan, mines: int) -> int:
    """Return how many twins hold so many mines."""
    return math.ceil(mines / plan.mines)


RECIPE, CONTRAST = "recipe", "contrast"
"""Names of what is compared."""
_MINES_OF_CHECK = 24
_FAR = 0.1  # false alarms per m²
_HALO = 0.5  # m: mines are 2 m apart and more
_SEED = 2026


def check_on_twins(run: xr.Dataset, recipe: Recipe, model: Model, track: Track = silent) -> Check:
    """Count the mines that a trained recipe and the contrast find on twins of an array's lanes.

    The contrast is that of the recipe which ``flgpr recipe for`` makes without another recipe.

    Parameters
    ----------
    run : xarray.Dataset
        A run of the array.
    recipe : Recipe
        The recipe, with a map of simulated signatures.
    model : Model
        What it has learnt.
    track : Track
        Shows progress.

    Raises
    ------
    ValueError
        If the array has no twins, see :func:`flgpr.jobs.check_on_twins.plan_twins`.
    """
    plan = plan_twins(run, recipe)
    numbers = range(twins_for(plan, _MINES_OF_CHECK))
    found: dict[str, list[pd.DataFrame]] = {RECIPE: [], CONTRAST: []}
    lanes = []
    for number in track(numbers, "checking on simulated lanes", len(numbers)):
        twin = simulate_twin(plan, number, _SEED)
        lanes.append(twin)
        plain = parse_recipe(fit_recipe(twin.run)).model_copy(update={"features": None})
        found[RECIPE].append(detect(twin.run, recipe, twin.lane, model=model).alarms)
        found[CONTRAST].append(detect(twin.run, plain, twin.lane).alarms)

    matches = {name: matched(tables, lanes) for name, tables in found.items()}
    compared = side_by_side(matches, [_FAR], means=False)
    n_detected = dict(zip(compared.points["detector"], compared.points["n_detected"], strict=True))
    pair = compared.pairs.iloc[0]
    return Check(
        lanes=len(lanes),
        mines=int(compared.points["n_targets"].iloc[0]),
        far=_FAR,
        found=int(n_detected[RECIPE]),
        by_contrast=int(n_detected[CONTRAST]),
        only_recipe=int(pair["only_first"]),
        only_contrast=int(pair["only_second"]),
        p=float(pair["p"]),
    )


def matched(tables: Sequence[pd.DataFrame], twins: Sequence[Twin], halo: float = _HALO) -> Match:
    """Match the alarms of twins to their mines."""
    alarms = []
    for table, twin in zip(tables, twins, strict=True):
        alarms.append(table[["x", "y", "confidence"]].assign(lane=twin.name))
    truth = pd.concat([twin.truth for twin in twins], ignore_index=True)
    lanes = {twin.name: twin.lane for twin in twins}
    return match(pd.concat(alarms, ignore_index=True), truth, lanes, halo)


def check_model(folder: Path, run: xr.Dataset, recipe: Recipe, model: Model, track: Track) -> None:
    """Check a trained model on twins, unless it is checked, and write the result beside it.

    A recipe whose signatures are not those of the run's own array is not checked. Where there are
    no twins of the array, the reason is written.

    Parameters
    ----------
    folder : Path
        Folder of the model.
    run : xarray.Dataset
        A run that it was trained on.
    recipe : Recipe
        Its recipe.
    model : Model
        What it has learnt.
    track : Track
        Shows progress.
    """
    if not is_fitted(recipe) or (folder / CHECK_FILE).is_file():
        return
    try:
        found: Check | str = check_on_twins(run, recipe, model, track=track)
    except ValueError as error:
        found = str(error)
    write_check(folder, found)


def is_fitted(recipe: Recipe) -> bool:
    """Return whether a recipe simulates the signatures of the run's own array."""
    return getattr(recipe.map_settings, "sensor", "") == OWN_ARRAY
