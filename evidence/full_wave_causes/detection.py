"""Experiments 1, 2 and 4: what `fused` and C_HH find, and by which covariance."""

from __future__ import annotations

import itertools

import numpy as np
import pandas as pd

from flgpr.method.imaged_run import ImagedRun
from flgpr.method.method import detection_of, engine_of
from flgpr.method.model import Model
from flgpr.recipe.schema import Recipe
from flgpr.scoring import assign, match
from flgpr.stages.likelihood import LikelihoodMap
from full_wave_causes.lanes import (
    LANE,
    OWN,
    SURFACES,
    WITH_OWN_ECHOES,
    LaneData,
    full_wave,
    twin,
    twin_scene,
)
from full_wave_causes.recipes import WIDE, contrast_recipe, fused_recipe
from full_wave_causes.signatures import scale_of

HALO = 0.5  # m, as everywhere on this lane
ALLOWED = 1  # false alarms
NEAR = 0.8  # m from a target, within which the strongest alarm is taken for its own
FOLDS = ((2.0, 3.4), (3.4, 4.8), (4.8, 6.2))  # m along the lane


def examples(recipe: Recipe, data: LaneData, blocked: pd.DataFrame | None = None) -> dict:
    """Return the sums of clutter of a lane, and the simulated signatures in its units."""
    setup = ImagedRun(
        data.run,
        recipe,
        data.lane,
        truth=data.blocked if blocked is None else blocked,
        explains=False,
    )
    engine_of(setup).run()
    return dict(setup.results["learn.map.likelihood"])


def learnt(recipe: Recipe, gathered: list[dict]) -> Model:
    """Return the model of covariance and signatures."""
    arrays, notes = LikelihoodMap.fit(recipe.map.settings, gathered)
    return Model(stages={"map.likelihood": arrays}, notes=notes)


def alarms_of(recipe: Recipe, data: LaneData, model: Model | None = None) -> pd.DataFrame:
    """Return the alarms of a lane; those of a map are ranked by it."""
    setup = ImagedRun(data.run, recipe, data.lane, model, explains=False)
    engine_of(setup).run()
    if recipe.map is None:
        return detection_of(setup).alarms[["x", "y", "confidence"]]
    alarms = setup.alarms()
    return alarms[["x", "y"]].assign(confidence=alarms["magnitude"])


def before_targets(alarms: pd.DataFrame, data: LaneData) -> np.ndarray:
    """Return the false alarms with which each target is found; infinite for one never found."""
    lane = "lane"
    truth = data.targets.assign(lane=lane)
    matched = match(alarms.assign(lane=lane), truth, {lane: data.lane}, HALO)
    found = assign(matched)
    return found["n_false"].where(found["detected"], np.inf).to_numpy()


def folded_alarms(recipe: Recipe, data: LaneData, prior: list[dict]) -> pd.DataFrame:
    """Return alarms whose covariance is that of the rest of the lane, with a prior if given.

    The prior counts as many chips as a chip has values.
    """
    parts = []
    for low, high in FOLDS:
        y = np.arange(low, high + 0.01, 0.2)
        x = np.arange(LANE.x_min, LANE.x_max + 0.01, 0.2)
        fold = pd.DataFrame(list(itertools.product(x, y)), columns=["x", "y"])
        blocked = pd.concat([data.blocked[["x", "y"]], fold], ignore_index=True)
        own = examples(recipe, data, blocked)
        model = learnt(recipe, [own, *scaled(prior, own)])
        alarms = alarms_of(recipe, data, model)
        inside = (alarms["y"] >= low) & (alarms["y"] < high)
        parts.append(alarms[inside])
    return pd.concat(parts, ignore_index=True)


def scaled(prior: list[dict], own: dict) -> list[dict]:
    """Return a prior's sums as if by metre they were of as many chips as a chip has values."""
    if not prior:
        return []
    total = np.sum([lane["covariance"] for lane in prior], axis=0)
    count = np.sum([lane["count"] for lane in prior], axis=0)
    size = total.shape[-1]
    mean = total.sum(axis=0) / count.sum()
    by_metre = np.where(
        count[:, None, None] >= size, total / np.maximum(count, 1)[:, None, None], mean
    )
    none = {name: values[:0] for name, values in own.items() if name not in ("covariance", "count")}
    return [none | {"covariance": size * by_metre, "count": np.full(len(count), float(size))}]


DETECTORS = {
    "C_HH": contrast_recipe(),
    "C_HH, early echoes out": contrast_recipe(early=True),
    "fused": fused_recipe(),
    "fused, early echoes out": fused_recipe(early=True),
    "its likelihood alone": fused_recipe(level=0.0),
    "its likelihood alone, early echoes out": fused_recipe(level=0.0, early=True),
    "fused in the sub-bands of miniature": fused_recipe(WIDE),
    "fused in the sub-bands of miniature, early echoes out": fused_recipe(WIDE, early=True),
}


def early_part(data: LaneData) -> np.ndarray:
    """Return what the stage `early` takes out of a run's signal."""
    recipe = contrast_recipe(early=True)
    setup = ImagedRun(data.run, recipe, data.lane, explains=False)
    stage = setup.clutter_stages["clutter.early"]
    signal = data.run["signal"].values
    print(stage.notes(), flush=True)
    return np.stack([scan - stage.clean(0, scan) for scan in signal])


def experiment_lanes(twins: int, known: list[LaneData], found: list[dict]) -> None:
    """Find the mines of the full-wave lane and of its twins, with their early echoes and without."""
    models: dict[str, Model | None] = {}
    for name, recipe in DETECTORS.items():
        models[name] = None
        if recipe.map is not None:
            models[name] = learnt(recipe, [examples(recipe, lane) for lane in known])
    real = full_wave()
    early = early_part(real) / scale_of(real.run)[0]

    def detect_all(world: str, seed: int, data: LaneData) -> None:
        for name, recipe in DETECTORS.items():
            add(found, world, seed, name, alarms_of(recipe, data, models[name]), data)

    detect_all("full wave", 0, real)
    for surface, numbers in SURFACES.items():
        scene = twin_scene(numbers)
        for seed in range(twins if surface == OWN else max(twins // 2, 1)):
            data = twin(scene, seed)
            detect_all(surface, seed, data)
            if surface == OWN and seed < max(twins // 2, 1):
                run = data.run.assign(signal=data.run["signal"] + early.astype(np.complex64))
                detect_all(WITH_OWN_ECHOES, seed, data._replace(run=run))


def add(found, world, seed, detector, alarms, data) -> None:
    """Add the false alarms before each target, and how far behind it the strongest alarm near it lies."""
    for target, count in zip(data.targets.itertuples(), before_targets(alarms, data), strict=True):
        off = np.hypot(alarms["x"] - target.x, alarms["y"] - target.y)
        near = alarms[off <= NEAR].sort_values("confidence")
        behind = near["y"].iloc[-1] - target.y if len(near) else np.nan
        found.append(
            {
                "world": world,
                "seed": seed,
                "detector": detector,
                "target": target.target_id,
                "false_alarms": count,
                "behind": behind,
            }
        )


def experiment_covariance(twins: int, known: list[LaneData], found: list[dict]) -> None:
    """Take the covariance of `fused` from other lanes, from twins, and from the lane itself."""
    bare = twin_scene(SURFACES[OWN], targets=False)
    count = max(twins // 4, 2)
    worlds = [("full wave", 0, full_wave())]
    scene = twin_scene(SURFACES[OWN])
    worlds += [(OWN, seed, twin(scene, seed)) for seed in range(count)]
    bare_twins = [twin(bare, 1000 + seed) for seed in range(12)]
    for early in (False, True):
        recipe = fused_recipe(early=early)
        name = "fused, early echoes out" if early else "fused"
        known_examples = [examples(recipe, lane) for lane in known]
        of_twins = learnt(recipe, [examples(recipe, lane) for lane in bare_twins])
        for world, seed, data in worlds:
            alarms = alarms_of(recipe, data, of_twins)
            add(found, world, seed, f"{name}; covariance of twins without targets", alarms, data)
            alarms = folded_alarms(recipe, data, [])
            add(found, world, seed, f"{name}; covariance of the lane itself", alarms, data)
            alarms = folded_alarms(recipe, data, known_examples)
            add(found, world, seed, f"{name}; the lane's, training lanes as prior", alarms, data)
