"""Lanes of Cosgrove et al. 2004 with something changed, and reflectors in place of its mines."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from flgpr.simulate import ALONE, BARE, Scene, Simulator
from flgpr_papers.cosgrove2004.images import (
    NO_ROADSIDE,
    SIGNATURE_SHARE,
    SIGNATURES,
    Look,
    from_other_end,
    lane_scene,
    lane_seed,
    stop_looks,
    study_sensor,
)
from flgpr_papers.cosgrove2004.recipe import StudyRecipe
from flgpr_papers.kit.scenes import changed


@dataclass(frozen=True)
class LaneChange:
    """How a lane differs from the study's, to see what the difference does.

    The names of the fields are part of the key of the records on disk.
    """

    #: entries of the scene's tables that are replaced, ``{"surface": {"correlation": 0.0}}``
    parts: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    #: entries of every mine that are replaced
    mine: Mapping[str, Any] = field(default_factory=dict)
    #: False takes the mines out, with the holes over them; looks are taken where they lay
    mines: bool = True


def open_looks(
    recipe: StudyRecipe, name: str, seed: int, share: float, change: LaneChange
) -> list[Look]:
    """Image the mines of an open lane with something changed on the lane.

    Everything else is as in :func:`lane_looks`, whose first four parameters it has.

    Parameters
    ----------
    recipe, name, seed, share
        As of :func:`lane_looks`.
    change : LaneChange
        What is changed.
    """
    number = lane_seed(recipe, name, seed)
    scene, trains, depths = lane_scene(recipe, recipe.sites[name], number, share)
    mines = [target.model_dump(exclude_unset=True) | dict(change.mine) for target in scene.targets]
    tables = {table: dict(entries) for table, entries in change.parts.items()}
    tables["clutter"] = NO_ROADSIDE | tables.get("clutter", {})
    ground = changed(scene, targets=mines, **tables)
    looks = []
    for direction in (0, 1):
        placed = _driven(ground, number, direction)
        simulated = placed
        if not change.mines:
            simulated = _driven(changed(ground, targets=[]), number, direction)
        # Driven back, the mines come in the opposite order.
        order = slice(None, None, -1) if direction == 1 else slice(None)
        simulator = Simulator(simulated, study_sensor(recipe), number + direction)
        mines = zip(depths[order], trains[order], strict=True)
        signature = recipe.image.self_signature
        looks += stop_looks(recipe, simulator, simulator.scans(), signature, mines, placed.targets)
    return looks


def _driven(scene: Scene, seed: int, direction: int) -> Scene:
    """Return a lane as it lies before the vehicle: direction 1 drives it from the other end."""
    return from_other_end(scene, seed) if direction == 1 else scene


def reflector_looks(recipe: StudyRecipe, name: str) -> list[Look]:
    """Image corner reflectors in place of a site's mines.

    There are no surface, other objects and errors of the radar. A corner reflector returns the same
    in HH and in VV.

    Parameters
    ----------
    recipe : StudyRecipe
        The study.
    name : str
        Name of the site.
    """
    scene, trains, depths = lane_scene(recipe, recipe.sites[name], SIGNATURES, SIGNATURE_SHARE)
    reflectors = []
    for target in scene.targets:
        reflectors.append({"kind": "fiducial", "x": target.x, "y": target.y, "rcs_db": 0.0})
    bare = changed(scene, targets=[], clutter=BARE, **ALONE).model_dump(exclude_unset=True)
    placed = Scene.model_validate(bare | {"objects": reflectors})
    simulator = Simulator(placed, study_sensor(recipe), SIGNATURES, errors=False)
    mines = zip(depths, trains, strict=True)
    return stop_looks(recipe, simulator, simulator.scans(), "none", mines, scene.targets)
