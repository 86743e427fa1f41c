"""Decks for gprMax as a folder of files."""

from __future__ import annotations

import json
from pathlib import Path

from flgpr.model import Sensor
from flgpr.simulate import Scene, draw_world
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
    texts = deck_texts()
    size, omissions = (
        "".join(f"- {item}\n" for item in items) for items in (decks.summary, decks.omissions)
    )
    files = {
        **decks.files,
        MANIFEST: json.dumps(decks.manifest, indent=1),
        "run.sh": texts["script"],
        "README.txt": f"{texts['readme']}Size:\n{size}\nNot written:\n{omissions}",
    }
    with atomic_output(target, more=True) as partial:  # results may have been added
        partial.mkdir()
        for name, text in files.items():
            (partial / name).write_text(text, encoding="utf-8")
        for name, table in (("truth", world.truth()), ("objects", world.objects_table())):
            write_table(table, partial / f"{name}.csv")
            write_geojson(table, partial / f"{name}.json")
        write_whole(partial / "lane.toml", lane_text(scene.lane))
    return decks
