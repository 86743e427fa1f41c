"""Detectors that enter a proving ground: recipes, classes of one's own and alarm lists."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np

from flgpr.model import vehicle_to_scan
from flgpr.recipe.choice import figures_of
from flgpr.recipe.like import like_text, load_model_recipe
from flgpr.recipe.radar_setup import RadarSetup, radar_setup
from flgpr.recipe.schema import parse_recipe, recipe_text
from flgpr.simulate.scene.world import draw_track
from flgpr.store import open_run
from flgpr.toml_text import parse_toml
from flgpr_ground.ground import GROUNDS, Ground, packaged_text
from flgpr_ground.own import OwnDetector, is_own, load_own

ORACLES = {
    "oracle": (
        "far",
        "knows every mine's echo but for a phase in each look, and the clutter's covariance",
    ),
    "oracle-phase": ("far_phase", "knows the phases, too"),
}
"""Rows of the table by :func:`flgpr_ground.oracle.run_oracle`: its column, and a title."""


@dataclass(frozen=True)
class Entry:
    """A detector that enters: a recipe, a class of one's own, or alarm lists made elsewhere."""

    name: str
    title: str
    text: str = ""  #: TOML text of the recipe, of which a class reads features or images
    alarms: Path | None = None  #: folder of the alarm lists; None for what runs here
    own: OwnDetector | None = None  #: the class of one's own


def packaged_entries(ground: Ground) -> dict[str, Entry]:
    """Return the packaged entries of a ground by name.

    They are packaged recipes in which some text is replaced, for the array of the ground or by the
    entry. More is replaced for the quick form, whose few mines would teach them nothing. On a
    ground with a recipe for its own array some are fitted to the array.

    Raises
    ------
    ValueError
        If what is to be replaced does not stand exactly once in a recipe, or the ground names
        entries that are not packaged.
    """
    rows = parse_toml(packaged_text("entries.toml"))
    entries = {}
    own_recipe = ground.table.recipe
    chosen = ground.table.entries or tuple(rows)
    unknown = ", ".join(sorted(set(chosen) - set(rows)))
    if unknown:
        raise ValueError(
            f"entries of a ground must be packaged ones, {', '.join(rows)}, got {unknown}"
        )
    for name, row in rows.items():
        source = row["recipe"]
        fitted = own_recipe and row.get("fitted")
        other_array = own_recipe and not fitted and (source != "wang2007" or "replace" in row)
        if name not in chosen or other_array:
            continue
        replacements = list(row.get("replace", []))
        if fitted:
            text = _fitted_text(ground, name, source)
        else:
            source = own_recipe or source
            text = recipe_text(source)
            replacements += ground.table.replace if own_recipe else ()
        if ground.quick:
            replacements += row.get("quick", [])
        for old, new in replacements:
            if text.count(old) != 1:
                raise ValueError(
                    f"entry {name} must replace what stands once in {source}, got {old!r}"
                )
            text = text.replace(old, new)
        top = f"confidence = {json.dumps(row['confidence'])}\n" if "confidence" in row else ""
        entries[name] = Entry(name, row["title"], f"{top}{text}\n{row.get('add', '')}")
    return entries


def _fitted_text(ground: Ground, name: str, recipe: str) -> str:
    """Return a packaged recipe fitted to the array of a ground.

    Entries of a packaged ground that have run stay as they ran, whatever the rules are since.
    """
    frozen = f"fitted/{ground.title}-{name}.toml"
    is_packaged = ground.title in GROUNDS and ground.text == packaged_text(f"{ground.title}.toml")
    if is_packaged and (resources.files("flgpr_ground") / frozen).is_file():
        return packaged_text(frozen)
    model = load_model_recipe(recipe)
    figures = figures_of(_array_of(ground), model.recipe)
    return like_text(figures, model, ground.table.sensor)


def _array_of(ground: Ground) -> RadarSetup:
    """Return what a recipe that is fitted to the array of a ground depends on."""
    lanes = list(ground.lanes.values())
    if not lanes:
        raise ValueError(f"ground must have a lane, got none in {ground.title}")
    lane = lanes[0]
    if lane.stored is not None:
        return radar_setup(open_run(lane.stored[0]))
    poses, _ = draw_track(lane.scene, lane.sensor.height, lane.seed)
    pose = np.median(poses, axis=0)
    tx, rx = (vehicle_to_scan(places, pose) for places in lane.sensor.pairs())
    return RadarSetup(list(lane.sensor.polarization), lane.sensor.tones.axis(), tx, rx, poses)


def find_entry(what: str | Path, ground: Ground) -> Entry:
    """Return an entry.

    Parameters
    ----------
    what : str or path
        Name of a packaged entry or recipe, a recipe's file, "module:Class" (:func:`load_own`), or a
        folder with alarm lists.
    ground : Ground
        The ground.

    Raises
    ------
    ValueError
        If there is no such entry.
    """
    entries = packaged_entries(ground)
    if str(what) in entries:
        return entries[str(what)]
    if is_own(what):
        return _own_entry(load_own(str(what)), entries, ground.title)
    path = Path(what)
    if path.is_dir():
        if not list(path.glob("*.csv")):
            raise ValueError(
                f"a folder that enters must hold alarm lists, SPLIT.csv, got none in {path}"
            )
        return Entry(path.name, f"alarms of {path.name}", alarms=path)
    try:
        text = recipe_text(what)
    except ValueError as error:
        if path.exists():
            raise
        raise ValueError(
            f"{error}; a class of your own is named MODULE:CLASS, and `flgpr benchmark list` lists "
            "the packaged entries"
        ) from None
    return Entry(path.stem, parse_recipe(text, str(what)).description, text)


def _own_entry(own: OwnDetector, entries: Mapping[str, Entry], title: str) -> Entry:
    """Return the entry of a class of one's own, with the text of the recipe that it reads from."""
    name = own.recipe or "wang2007"
    text = entries[name].text if name in entries else recipe_text(name)
    recipe = parse_recipe(text, name)
    if not own.takes_lanes and recipe.features is None and not recipe.columns:
        raise ValueError(
            f"{own.path} must read features of alarms, got {name} on {title}, which has none, as "
            "those of Wang et al. need HH, HV and VV: write fit(lanes) and detect(lane) instead, "
            "or name a recipe with features in `recipe`"
        )
    if recipe.learning() or recipe.detector is not None:
        raise ValueError(
            f"recipe of {own.path} must be one in which nothing learns, as wang2007, got {name}"
        )
    if own.name in entries:
        raise ValueError(
            f"{own.path} must not have the name of a packaged entry, got {own.name}: rename the class"
        )
    return Entry(own.name, own.method, text, own=own)
