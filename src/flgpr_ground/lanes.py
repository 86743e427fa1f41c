"""The lanes of a proving ground in its folder: made once, those that are tested on sealed.

The folder has the ground's description, and its lanes in ``lanes``.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from flgpr.door import Folder
from flgpr.jobs.workers import DEFAULTS, Report, RunOptions
from flgpr.store import open_run, read_manifest, write_table, write_whole
from flgpr.store.files import existing
from flgpr.store.outputs import log_finished
from flgpr.store.run_writer import is_finished
from flgpr.store.tables import parse_columns, parse_csv
from flgpr.types import Entries, floats
from flgpr_ground.entries import packaged_entries
from flgpr_ground.ground import Ground, LaneData, load_ground, packaged_text
from flgpr_trials.sealing import seal_truth

SEALED = "truth.sealed.json"
PRINTS = "fingerprints.csv"
MARK = "ground.json"


def read_ground(folder: Path) -> Ground:
    """Read the ground of a benchmark's folder; a ValueError if it is none."""
    if not Folder(folder).has(MARK):
        raise ValueError(f"folders must be those of `flgpr benchmark run`, got {folder}")
    quick = bool(Folder(folder).json(MARK)["quick"])
    return load_ground(quick, folder / "ground.toml")


def common_ground(folders: Sequence[Path]) -> Ground:
    """Read the ground that all folders are of; several are a ValueError."""
    grounds = [read_ground(folder) for folder in folders]
    if any(ground != grounds[0] for ground in grounds):
        titles = ", ".join(ground.title for ground in grounds)
        raise ValueError(f"folders must all be of one ground, got {titles}")
    return grounds[0]


def passphrase(ground: Ground) -> str:
    """Return the passphrase of the sealed truth.

    It is public: the seal guards against accidents, not against who means to look.
    """
    return f"the truth of {ground.title}"


def make_lanes(
    ground: Ground, folder: Path, options: RunOptions, tiers: Sequence[Ground] | None = None
) -> None:
    """Simulate the lanes that are not there yet.

    The truth of all test lanes is sealed, that of the others lies beside them. Fingerprints are
    taken of all lanes that are there.

    Parameters
    ----------
    ground : Ground
        The ground with all of its tiers.
    folder : Path
        Takes the lanes.
    options : RunOptions
        Who does the work.
    tiers : sequence of Ground, optional
        The tiers whose lanes are made; by default all.
    """
    seal_tested(ground, folder)
    missing = []
    for tier in tiers or ground.chosen_tiers():
        missing += [name for name in tier.lanes if not is_finished(folder / f"{name}.zarr")]
    with options.executor() as executor:
        jobs = [(ground.quick, ground.text, name, str(folder.resolve())) for name in missing]
        for _ in options.track(executor.run(make_lane, jobs), "simulating lanes", len(jobs)):
            pass

    present = Folder(folder).read_if_listed(PRINTS)
    known: dict[Any, Any] = {}  # prints that were taken are not taken anew
    if present is not None:
        known = parse_columns(present).set_index("sha256", drop=False).to_dict("index")
    rows = []
    for name in ground.lanes:
        store = folder / f"{name}.zarr"
        if is_finished(store):
            rows.append(known.get(read_manifest(store)["sha256"]) or fingerprint(folder, name))
    write_whole(folder / PRINTS, pd.DataFrame(rows).to_csv(index=False, float_format="%.7g"))


def seal_tested(ground: Ground, folder: Path) -> None:
    """Seal the truth of all test lanes, if that was not done yet."""
    folder.mkdir(parents=True, exist_ok=True)
    if (folder / SEALED).is_file():
        return
    tables = []
    borders = {}
    for lane in ground.lanes.values():
        if lane.part == "test":
            truth = lane.truth_with_bodies() if ground.table.tiers else lane.truth()
            # Named so that those of all lanes are different.
            names = lane.name + "-" + truth["target_id"]
            tables.append(truth.assign(lane=lane.name, target_id=names))
            borders[lane.name] = lane.lane
    truth = pd.concat(tables, ignore_index=True)
    seal_truth(truth, borders, folder / SEALED, passphrase(ground), halo=ground.table.halo)


def make_lane(quick: bool, ground: str, name: str, folder: str) -> Report:
    """Simulate one lane, with its truth beside it unless that is sealed.

    Parameters
    ----------
    quick : bool
        Whether the ground is the quick form.
    ground : str
        TOML text of the ground.
    name : str
        Name of the lane.
    folder : str
        Takes the lane.

    Returns
    -------
    Report
        The name of the ``lane``.
    """
    lane = load_ground(quick, ground).lanes[name]
    if lane.part != "test":
        write_table(lane.truth(), Path(folder) / f"{name}-truth.csv")
    lane.make(Path(folder) / f"{name}.zarr")
    return {"lane": name}


def fingerprint(folder: Path, name: str) -> Entries:
    """Return a lane's digest, and the rms of its echoes by polarization.

    By the rms lanes of machines are compared that compute other bits.
    """
    store = folder / f"{name}.zarr"
    run = open_run(store)
    power = np.abs(run["signal"].values) ** 2
    level = np.sqrt(np.nanmean(power, axis=(0, 2, 3), dtype=float))
    labels = [str(label) for label in run["polarization"].values]
    return {
        "lane": name,
        "sha256": read_manifest(store)["sha256"],
        **dict(zip(labels, level, strict=True)),
    }


def begin_folder(ground: Ground, folder: Path) -> None:
    """Make the folder of a ground, with its description; one of another ground is a ValueError."""
    if Folder(folder).has(MARK) and read_ground(folder) != ground:
        raise ValueError(
            f"output must be a folder of {ground.title} as it is now, got one of another ground: "
            f"{folder}"
        )
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / "ground.toml", ground.text)
    write_whole(folder / MARK, json.dumps({"ground": ground.title, "quick": ground.quick}) + "\n")


def make_ground(
    output: str | Path,
    quick: bool = False,
    how: RunOptions = DEFAULTS,
    ground: str | Path | None = None,
    tier: str | None = None,
) -> Path:
    """Make the lanes of a proving ground, and run no detector.

    Parameters
    ----------
    output : str or path
        Folder of the ground, as for :func:`run_benchmark`, which goes on from there.
    quick : bool
        The quick form.
    how : RunOptions, optional
        Who does the work.
    ground : str or path, optional
        Name of a packaged proving ground, by default the newest, or a TOML file.
    tier : str, optional
        The tier whose lanes are made; by default, and with "all", every tier.

    Returns
    -------
    Path
        The folder, with run stores, borders, truth of the lanes that are not sealed, the sealed
        truth and fingerprints in ``lanes``.

    Raises
    ------
    ValueError
        If the folder is of another form of the ground, or the ground has no such tier.
    """
    chosen = load_ground(quick, ground)
    tiers = chosen.chosen_tiers(tier)
    folder = Path(output)
    begin_folder(chosen, folder)
    lanes = folder / "lanes"
    before = Folder(lanes).read(PRINTS) if Folder(lanes).has(PRINTS) else None
    make_lanes(chosen, lanes, how, tiers)
    if Folder(lanes).read(PRINTS) == before:
        log_finished(lanes)
    return folder


def open_lane(
    name: str,
    folder: str | Path = "proving-ground",
    quick: bool = False,
    ground: str | Path | None = None,
) -> LaneData:
    """Return a lane of a proving ground with its run, image and truth; it is made if it is not there.

    Parameters
    ----------
    name : str
        Name of the lane, as ``flgpr benchmark list`` gives it.
    folder : str or path
        Folder of the ground, as for :func:`run_benchmark`.
    quick, ground
        As for :func:`run_benchmark`.

    Returns
    -------
    LaneData
        The lane. The truth of test lanes is sealed.

    Raises
    ------
    ValueError
        If the ground has no such lane, or the folder is of another one.

    Examples
    --------
    A packaged full-wave lane needs no simulation:

    >>> import tempfile
    >>> from flgpr.proving_ground import open_lane
    >>> lane = open_lane("arid-lane-1", tempfile.mkdtemp(), ground="full-wave-1")
    >>> lane.part, dict(lane.run["signal"].sizes)
    ('test', {'scan': 3, 'polarization': 4, 'pair': 32, 'frequency': 142})
    """
    chosen = load_ground(quick, ground)
    if name not in chosen.lanes:
        known = ", ".join(chosen.lanes)
        raise ValueError(f"name must be that of a lane of {chosen.title}, {known}, got {name!r}")
    begin_folder(chosen, Path(folder))
    lanes = Path(folder) / "lanes"
    lanes.mkdir(exist_ok=True)
    if not is_finished(lanes / f"{name}.zarr"):
        make_lane(quick, chosen.text, name, str(lanes.resolve()))
    recipe = packaged_entries(chosen)["wang2007"].text
    return chosen.lanes[name].data(lanes, recipe)


def same_lanes(ground: Ground, folder: Path) -> dict[str, str]:
    """Compare lanes with the packaged fingerprints.

    Parameters
    ----------
    ground : Ground
        The ground.
    folder : Path
        Folder of the lanes.

    Returns
    -------
    dict of str to str
        "same bits", "alike", "other", "not there" or "not known" by the name of the lane.
    """
    existing(folder / PRINTS, "fingerprints of lanes")
    return likeness_of(ground, Folder(folder).read(PRINTS))


def likeness_of(ground: Ground, prints: bytes) -> dict[str, str]:
    """Compare the fingerprints of lanes with the packaged ones, as :func:`same_lanes` does.

    Parameters
    ----------
    ground : Ground
        The ground.
    prints : bytes
        Table of fingerprints, which may come from anyone.

    Returns
    -------
    dict of str to str
        "same bits", "alike", "other", "not there" or "not known" by the name of the lane.

    Raises
    ------
    ValueError
        If it is no such table.
    """
    known = packaged_fingerprints(ground)
    table = parse_columns(prints, "lane", "sha256")
    if not {"lane", "sha256"} <= set(table.columns):
        raise ValueError(
            f"fingerprints must have the columns lane and sha256, got {', '.join(table.columns)}"
        )
    present = table.set_index("lane")
    if present.index.has_duplicates:
        raise ValueError("fingerprints must have every lane once, got one again")
    likeness = {}
    for name in ground.lanes:
        likeness[name] = "not there" if name not in present.index else "not known"
        if name in present.index and name in known.index:
            likeness[name] = _compared(present.loc[name], known.loc[name])
    return likeness


def packaged_fingerprints(ground: Ground) -> pd.DataFrame:
    """Return the authors' fingerprints of the lanes of a ground.

    Parameters
    ----------
    ground : Ground
        The ground.

    Returns
    -------
    pandas.DataFrame
        By the name of the lane: ``sha256`` and the rms of the echoes of every polarization. There
        are no rows for a ground of somebody else.
    """
    table = parse_csv(packaged_text("fingerprints.csv"))
    title_and_lane = table["lane"].str.split(" ", n=1, expand=True)
    rows = table.assign(lane=title_and_lane[1])[title_and_lane[0] == ground.title]
    return rows.set_index("lane")


def _compared(present: Any, known: Any) -> str:
    """Return how alike two lanes are, by a row of each table of fingerprints."""
    if present["sha256"] == known["sha256"]:
        return "same bits"
    levels = [column for column in known.index if column != "sha256" and pd.notna(known[column])]
    try:
        measured = [float(present[column]) for column in levels]
    except (KeyError, TypeError, ValueError):
        return "other"  # no number for a polarization
    is_alike = np.allclose(measured, floats(known[levels]), rtol=1e-4, atol=0)
    return "alike" if is_alike else "other"
