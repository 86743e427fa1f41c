"""Decks for gprMax as a folder of files."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from flgpr.model import Sensor
from flgpr.simulate import Scene, World, draw_world
from flgpr.store import lane_text, write_geojson, write_table, write_whole
from flgpr.store.outputs import atomic_output
from flgpr_exchange.gprmax.deck_results import MANIFEST, deck_texts
from flgpr_exchange.gprmax.decks import Decks, make_decks

PathLike = str | Path


def write_gprmax_decks(
    scene: Scene,
    sensor: Sensor,
    seed: int,
    folder: PathLike,
    cells_per_wavelength: float = 10.0,
    max_cells: float = 3e8,
) -> Decks:
    """Write a scene's gprMax decks into a new folder, with truth, objects and lane.

    Parameters
    ----------
    scene, sensor, seed, cells_per_wavelength, max_cells
        As for :func:`flgpr.simulate.make_decks`.
    folder : path
        Folder to make.

    Returns
    -------
    Decks
        What was written, with its size, and what of the scene is not in it.

    Raises
    ------
    FileExistsError
        If anything else is there. A folder with these decks stays, with or without results.
    """
    target = Path(folder)
    decks = make_decks(scene, sensor, seed, cells_per_wavelength, max_cells)
    world = draw_world(scene, seed)
    target.parent.mkdir(parents=True, exist_ok=True)
    with atomic_output(target, more=True) as partial:  # results may have been added
        partial.mkdir()
        for name, text in decks.files.items():
            (partial / name).write_text(text, encoding="utf-8")
        manifest = json.dumps(decks.manifest, indent=1)
        (partial / MANIFEST).write_text(manifest, encoding="utf-8")
        texts = deck_texts()
        (partial / "run.sh").write_text(texts["script"], encoding="utf-8")
        readme = _readme(texts["readme"], decks)
        (partial / "README.txt").write_text(readme, encoding="utf-8")
        _write_world_tables(world, partial)
        write_whole(partial / "lane.toml", lane_text(scene.lane))
    return decks


def _readme(introduction: str, decks: Decks) -> str:
    """Return the README of decks: what they are, their size, and what is not in them."""
    size = _bullets(decks.summary)
    omissions = _bullets(decks.omissions)
    return f"{introduction}Size:\n{size}\nNot written:\n{omissions}"


def _bullets(items: Sequence[str]) -> str:
    """Return a list in Markdown."""
    return "".join(f"- {item}\n" for item in items)


def _write_world_tables(world: World, folder: Path) -> None:
    """Write truth and objects of a world as CSV and GeoJSON."""
    for name, table in (("truth", world.truth()), ("objects", world.objects_table())):
        write_table(table, folder / f"{name}.csv")
        write_geojson(table, folder / f"{name}.json")
