"""Why `fused` misses the mines of the packaged full-wave lane: four experiments, each of which could refute its cause.

``python evidence/why_full_wave.py OUT [--twins 40] [--figure docs/images/fused-full-wave.png]`` writes CSV files into
OUT, prints Markdown tables and draws the figure; four minutes of one core. The lane has three mines, which by
themselves decide nothing (0 of 3 against 2 of 3: p = 0.5). So twins of the lane, simulated over other surfaces, tell
what to expect of either detector, and the full-wave lane is held against their spread.

The recipe of `fused` for this array is put together here by hand: the packaged one with the images, windows and radii
of the recipe `miniature`.

1. *Clutter.* The twin has the lane's array, soil, targets, rock and post; its surface is drawn anew. If the rough
   surface, or the low array, is the cause, `fused` misses the mines of the twins as well.
2. *Covariance.* `fused` takes its covariance from lanes of the proving ground, from twins without targets, or from the
   full-wave lane itself, where no chip is tried with a covariance that it is in (three folds). If a wrong covariance is
   the cause, the lane's own one finds the mines.
3. *Signatures.* The echo of a body alone, full wave with the body less full wave without it (tests/data/signatures), is
   held against the simulator's and against the directions in which `fused` looks. In the lane, chips at the mines are
   held against the simulated echo of each mine, in the twins as in the full-wave lane. No full-wave lane was computed
   with and without its targets. If the signatures are the cause, full wave correlates less than the twins do.
4. *The array's own echoes*, which the twins lack: the direct wave, and the ground under the array. The stage `early`
   takes them out by their path, in the whole band. If they are the cause, the full-wave lane without them is like the
   twins, and the twins with them are like the full-wave lane.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.figure import Figure

ROOT = Path(__file__).parent.parent
sys.path += [str(ROOT / "tests"), str(ROOT / "evidence")]
from flgpr.chain.lane_setup import LaneSetup  # noqa: E402
from flgpr.chain.method import detection_of, engine_of  # noqa: E402
from flgpr.chain.model import Model  # noqa: E402
from flgpr.chain.recipe import Recipe, parse_recipe, recipe_text  # noqa: E402
from flgpr.chain.stages.body_signatures import Bodies, Imaging, signatures  # noqa: E402
from flgpr.chain.stages.likelihood import LikelihoodMap  # noqa: E402
from flgpr.clutter import early_basis, subtract_early  # noqa: E402
from flgpr.imaging import ImagingOperator, ScanImager  # noqa: E402
from flgpr.model import SPEED_OF_LIGHT, Grid, Lane, lane_to_scan, load_sensor  # noqa: E402
from flgpr.proving_ground import load_ground  # noqa: E402
from flgpr.scoring import clopper_pearson, label_alarms, match  # noqa: E402
from flgpr.simulate import Scene, Simulator  # noqa: E402
from flgpr.store import open_run, read_table, sample_lane  # noqa: E402
from flgpr.store.tables import read_columns  # noqa: E402
from simulate import fullwave_difference as difference  # noqa: E402
from validate_fullwave import lane_scene  # noqa: E402

LANE = Lane(-1.0, 1.0, 2.0, 6.2)
HALO = 0.5  # m, as everywhere on this lane
ALLOWED = 1  # false alarms
NEAR = 0.8  # m from a target, within which the strongest alarm is taken for its own
CLEAR = 0.6  # m about targets in which no clutter is learnt: the lane is 2 m wide
FOLDS = ((2.0, 3.4), (3.4, 4.8), (4.8, 6.2))  # m along the lane
SURFACES = {  # rms height and correlation length, m
    "rms 1.5 mm": (0.0015, 0.10),
    "rms 3 mm": (0.003, 0.10),
    "rms 6 mm, the lane's": (0.006, 0.10),
    "rms 9 mm": (0.009, 0.10),
    "rms 6 mm, correlated over 5 cm": (0.006, 0.05),
}
OWN = "rms 6 mm, the lane's"
WITH_OWN_ECHOES = OWN + ", with the full-wave lane's early echoes"
EARLY = '[[clutter]]\nstage = "early"\n'
HEAD = """
name = "{name}"
description = "{name}"
[image]
x = [-1.4, 1.4]
y = [1.2, 5.84]
spacing = 0.025
window = "hann"
tolerance = 1e-3
[image.subbands]
{subbands}
[background]
self_signature = "none"
median = 1.0
mean = 1.25
{early}
"""
LOW = "B0 = [0.45e9, 0.60e9]\nB1 = [0.60e9, 0.80e9]\nB2 = [0.80e9, 1.05e9]"
WIDE = "F0 = [0.45e9, 1.5e9]\nF1 = [0.45e9, 1.05e9]\nF2 = [0.9e9, 1.5e9]"
TAIL = """
[map]
stage = "likelihood"
sensor = "full-wave"
clear = {clear}
level = {level}
[run_view]
x = [-1.4, 1.4]
spacing = 0.05
y_max = 5.84
look = "mean"
falloff = 2
[prescreen]
polarization = "likelihood"
subband = "all"
radius = 0.375
density = 0.75
count = "view"
[contrast]
polarization = "HH"
subband = "{subband}"
size = 13
spacing = 0.1
inner = [5, 3]
guard = [9, 7]
[score]
halo = 0.5
area = "union"
"""


def fused_recipe(
    subbands: str = LOW, level: float = 2.0, early: bool = False, clear: float = CLEAR
) -> Recipe:
    """Return `fused` for this array: with other sub-bands, another weight of the contrast, or without early echoes."""
    subband = "B1" if subbands == LOW else "F0"
    head = HEAD.format(name="fused", subbands=subbands, early=EARLY if early else "")
    return parse_recipe(head + TAIL.format(clear=clear, level=level, subband=subband))


def contrast_recipe(early: bool = False) -> Recipe:
    """Return C_HH of Wang et al. 2007 for this array: `miniature` without its other features."""
    text = recipe_text("miniature").replace("[features]\ninner = [5, 3]\n", "")
    return parse_recipe(text + (EARLY if early else ""))


class LaneData(NamedTuple):
    """A run in memory with what lies in it."""

    run: xr.Dataset
    lane: Lane
    targets: pd.DataFrame  # the mines
    blocked: pd.DataFrame  # where no clutter is learnt: mines, and objects of the lane


# What is there: the full-wave lane, its twins, the training lanes of its proving ground


def full_wave() -> LaneData:
    """Return the packaged lane."""
    folder = sample_lane()
    run = open_run(folder / "run.zarr")
    truth = read_table(folder / "truth.csv", "truth")
    objects = read_table(folder / "objects.csv", "objects")
    blocked = pd.concat([truth[["x", "y"]], objects[["x", "y"]]], ignore_index=True)
    return LaneData(run, LANE, truth, blocked)


def twin_scene(surface: tuple[float, float], targets: bool = True) -> Scene:
    """Return the scene of the packaged lane, over a surface, with its targets or without."""
    real = full_wave()
    objects = read_table(sample_lane() / "objects.csv", "objects")
    scene = lane_scene(real.run, real.targets, objects)
    rms, length = surface
    rough = scene.surface.model_copy(update={"rms_height": rms, "correlation_length": length})
    changes = {"surface": rough}
    if not targets:
        changes["targets"] = ()
    return scene.model_copy(update=changes)


def twin(scene: Scene, seed: int) -> LaneData:
    """Return a twin of the packaged lane."""
    simulator = Simulator(scene, load_sensor("full-wave"), seed)
    real = full_wave()
    blocked = real.blocked
    if not scene.targets:
        blocked = blocked.iloc[len(real.targets) :]
    return LaneData(simulator.run(), LANE, real.targets, blocked)


def known_lanes(count: int) -> list[LaneData]:
    """Return the first training lanes of the full-wave proving ground."""
    lanes = []
    for lane in load_ground(False, "full-wave-1").lanes.values():
        if lane.part == "train" and len(lanes) < count:
            run = Simulator(lane.scene, lane.sensor, lane.seed).run()
            truth = lane.truth()
            lanes.append(LaneData(run, lane.lane, truth, truth[["x", "y"]]))
    return lanes


# What is learnt, and what is found


def examples(recipe: Recipe, data: LaneData, blocked: pd.DataFrame | None = None) -> dict:
    """Return the sums of clutter of a lane, and the simulated signatures in its units."""
    setup = LaneSetup(
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
    setup = LaneSetup(data.run, recipe, data.lane, model, explains=False)
    engine_of(setup).run()
    if recipe.map is None:
        return detection_of(setup).alarms[["x", "y", "confidence"]]
    alarms = setup.alarms()
    return alarms[["x", "y"]].assign(confidence=alarms["magnitude"])


def before_targets(alarms: pd.DataFrame, data: LaneData) -> np.ndarray:
    """Return the false alarms with which each target is found; infinite for one never found."""
    lane = "lane"
    truth = data.targets.assign(lane=lane)
    labelled = label_alarms(match(alarms.assign(lane=lane), truth, {lane: data.lane}, HALO))
    false = labelled.loc[labelled["label"] == "false", "confidence"].to_numpy()
    counts = np.full(len(truth), np.inf)
    for row in labelled[labelled["label"] == "detection"].itertuples():
        counts[row.target] = np.count_nonzero(false >= row.confidence)
    return counts


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


# Experiments 1 and 4

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
    setup = LaneSetup(data.run, recipe, data.lane, explains=False)
    stage = setup.images.stages["clutter.early"]
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


# Experiment 2


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


# Experiment 3

BANDS = {
    "B0": (0.45e9, 0.60e9),
    "B1": (0.60e9, 0.80e9),
    "B2": (0.80e9, 1.05e9),
    "F0": (0.45e9, 1.5e9),
}
CHIP_BANDS = 3  # the first three are those of `fused`; the last is that of C_HH
CHIP = np.stack([*np.meshgrid([-0.2, 0.0, 0.2], [-0.2, 0.0, 0.2]), np.zeros((3, 3))], axis=-1)
CHIP = CHIP.reshape(-1, 3)
RANK = 12  # directions in which `fused` looks


def coherence(one: np.ndarray, other: np.ndarray) -> float:
    """Return the magnitude of the correlation of two arrays."""
    norm = np.linalg.norm(one) * np.linalg.norm(other)
    return float(np.abs(np.vdot(one, other)) / norm) if norm else np.nan


def decibels(ratio: float) -> float:
    return float(20 * np.log10(ratio)) if ratio > 0 else np.nan


def by_difference() -> list[dict]:
    """Hold the echoes of bodies alone against the simulator's, and against the directions."""
    rows = []
    vectors = None
    for name in difference.names():
        case = difference.load(name)
        centre = np.array([*case.body["position_m"][:2], 0.0])
        operator = ImagingOperator(
            case.frequency,
            case.tx,
            case.rx,
            centre + CHIP,
            list(BANDS.values())[:CHIP_BANDS],
            tolerance=1e-4,
            window="hann",
        )
        full = operator.adjoint(case.signal)
        simulated = operator.adjoint(difference.simulated(case))
        if vectors is None:
            vectors = directions(case)
        row = {
            "case": name,
            "coherence": coherence(full, simulated),
            "level_db": decibels(np.linalg.norm(full) / np.linalg.norm(simulated)),
            "share_full_wave": share(full, vectors),
            "share_simulated": share(simulated, vectors),
        }
        for number, label in enumerate(case.polarization):
            if label in ("HH", "VV"):
                for band, low in enumerate(list(BANDS)[:CHIP_BANDS]):
                    row[f"coherence_{label}_{low}"] = coherence(
                        full[number, band], simulated[number, band]
                    )
                    row[f"level_db_{label}_{low}"] = decibels(
                        np.linalg.norm(full[number, band]) / np.linalg.norm(simulated[number, band])
                    )
        rows.append(row)
    return rows


def directions(case) -> np.ndarray:
    """Return the directions (12, value) of the metal mines' signatures, for a case's array."""
    settings = fused_recipe().map.settings
    bodies = Bodies(settings.kinds, settings.depths, settings.soils, settings.copies, settings.step)
    imaging = Imaging(
        grid=Grid.spanning((-0.6, 0.6), (1.2, 2.6), 0.025),
        subbands=tuple(BANDS.items())[:CHIP_BANDS],
        polarizations=tuple(case.polarization),
        window="hann",
        tolerance=1e-4,
        pixels=tuple(map(tuple, CHIP[:, :2])),
        limits=(-0.5, 0.5),
    )
    chips, _ = signatures(bodies, difference.sensor(case), imaging)
    flat = chips.reshape(len(chips), -1)
    flat = flat / np.linalg.norm(flat, axis=1, keepdims=True)
    return np.linalg.svd(flat, full_matrices=False)[2][:RANK]


def share(chip: np.ndarray, vectors: np.ndarray) -> float:
    """Return the share of a chip's power in directions."""
    flat = chip.ravel()
    return float((np.abs(vectors.conj() @ flat) ** 2).sum() / (np.abs(flat) ** 2).sum())


def scale_of(run: xr.Dataset) -> tuple[float, float]:
    """Return the data's scale, and its standard deviation over pairs (dB), by the direct wave.

    The field of a short vertical dipole at another beside it is known (near field included). Data
    and closed form are compared at the delay of the direct wave, under a Hann window, in VV. Pairs
    nearer than 0.4 m are left out, which the solver's cells do not resolve, and pairs farther than
    1.5 m, near whose delay the ground's echo lies.
    """
    frequency = run["frequency"].values
    tx = run["tx_position"].values
    rx = run["rx_position"].values
    signal = run["signal"].sel(polarization="VV").values
    window = np.hanning(frequency.size)
    k = 2 * np.pi * frequency / SPEED_OF_LIGHT
    ratios = []
    for pair in range(len(tx)):
        off = rx[pair] - tx[pair]
        r = np.linalg.norm(off)
        if not 0.4 < r < 1.5:
            continue
        cosine = off[2] / r
        along = 2 * cosine**2 * (1 / (1j * k * r) + 1 / (1j * k * r) ** 2)
        across = (1 - cosine**2) * (1 + 1 / (1j * k * r) + 1 / (1j * k * r) ** 2)
        # j times the field over the current moment; the free-space impedance is 376.7 ohm.
        field = 376.73 * k / (4 * np.pi * r) * (across - along)
        closed = (window * field).sum()
        focused = (window * signal[:, pair] * np.exp(1j * k * r)).sum(axis=-1)
        ratios.append(np.abs(focused) / np.abs(closed))
    decibel = 20 * np.log10(np.array(ratios))
    return float(10 ** (np.median(decibel) / 20)), float(decibel.std())


def chips_at(run: xr.Dataset, scan: int, places: np.ndarray, signal=None) -> np.ndarray:
    """Return chips (place, polarization, band, pixel) of a scan's image at places of the lane."""
    imager = ScanImager(run, Grid.spanning((-1.4, 1.4), (1.2, 5.84), 0.1), BANDS, "hann", 1e-4)
    points = lane_to_scan(
        np.column_stack([places, np.zeros(len(places))]), run["pose"].values[scan]
    )
    operator = imager.operator_on(scan, (points[:, None] + CHIP).reshape(-1, 3), imager.subbands)
    image = operator.adjoint(imager.signal(scan) if signal is None else signal)
    chips = image.reshape(*image.shape[:2], len(places), len(CHIP))
    return np.moveaxis(chips, 2, 0)


def echoes_alone(real: LaneData) -> dict[str, list[np.ndarray]]:
    """Return the simulated signal of each mine alone in every scan: flat ground, nothing else."""
    scene = twin_scene((0.0, 0.10))
    echoes = {}
    for target, row in zip(scene.targets, real.targets.itertuples(), strict=True):
        one = scene.model_copy(update={"targets": (target,), "objects": ()})
        simulator = Simulator(one, load_sensor("full-wave"), 0)
        echoes[row.target_id] = [simulator.bodies(scan) for scan in range(len(simulator))]
    return echoes


def free_places(data: LaneData) -> np.ndarray:
    """Return places of the lane away from all targets and objects."""
    x, y = np.meshgrid(np.arange(-0.8, 0.81, 0.2), np.arange(2.2, 6.01, 0.2))
    places = np.column_stack([x.ravel(), y.ravel()])
    off = np.linalg.norm(places[:, None] - data.blocked[["x", "y"]].to_numpy(), axis=-1)
    return places[off.min(axis=1) > CLEAR]


def without_early(signal: np.ndarray, basis: np.ndarray | None) -> np.ndarray:
    """Return a signal without early echoes, or as it is without a basis."""
    return signal if basis is None else subtract_early(signal, basis)


def in_the_lane(twins: int) -> tuple[list[dict], list[dict], tuple[float, float]]:
    """Hold chips at the mines against their simulated echoes, and the ground's level."""
    real = full_wave()
    scale, spread = scale_of(real.run)
    echoes = echoes_alone(real)
    free = free_places(real)
    worlds = [("full wave", 0, real, scale)]
    scene = twin_scene(SURFACES[OWN])
    worlds += [(OWN, seed, twin(scene, seed), 1.0) for seed in range(twins)]
    setup = LaneSetup(real.run, contrast_recipe(early=True), LANE, explains=False)
    path = setup.images.stages["clutter.early"].notes()["early_path"]
    basis = early_basis(real.run["frequency"].values, path)
    rows = []
    clutter = []
    labels = [str(name) for name in real.run["polarization"].values]
    for (world, seed, data, unit), out in itertools.product(worlds, (None, basis)):
        head = {"world": world, "seed": seed, "early_out": out is not None}
        ground = []
        for scan, raw in enumerate(data.run["signal"].values):
            signal = without_early(raw, out)
            at_free = chips_at(data.run, scan, free, signal) / unit
            ground.append(np.abs(at_free[..., 4]) ** 2)
            for target in data.targets.itertuples():
                place = np.array([[target.x, target.y]])
                alone = without_early(echoes[target.target_id][scan], out)
                chip = chips_at(data.run, scan, place, signal)[0, :, :CHIP_BANDS] / unit
                echo = chips_at(data.run, scan, place, alone)[0, :, :CHIP_BANDS]
                by_chance = [coherence(echo, other[:, :CHIP_BANDS]) for other in at_free]
                row = head | {"target": target.target_id, "scan": scan}
                row["coherence"] = coherence(echo, chip)
                row["by_chance_95"] = float(np.quantile(by_chance, 0.95))
                row["level_db"] = decibels(np.linalg.norm(chip) / np.linalg.norm(echo))
                for label in ("HH", "VV"):
                    number = labels.index(label)
                    row[f"coherence_{label}"] = coherence(echo[number], chip[number])
                    row[f"level_db_{label}"] = decibels(
                        np.linalg.norm(chip[number]) / np.linalg.norm(echo[number])
                    )
                rows.append(row)
        power = np.mean(np.concatenate(ground), axis=0)
        for number, label in enumerate(labels):
            for band, name in enumerate(BANDS):
                level = 10 * np.log10(power[number, band])
                clutter.append(head | {"polarization": label, "band": name, "level_db": level})
    return rows, clutter, (scale, spread)


# Tables and figure


def of_three(counts: pd.Series) -> str:
    """Tell how many of a lane's targets are found at one false alarm: mean, and how often 0, 1, 2, 3 of them."""
    found = counts.groupby(level="seed").sum()
    shares = [int((found == number).sum()) for number in range(4)]
    low, high = np.percentile(found, [2.5, 97.5])
    spread = "" if len(found) == 1 else f" ({low:.0f} to {high:.0f}; {', '.join(map(str, shares))})"
    return f"{found.mean():.1f}{spread}"


def report_found(table: pd.DataFrame) -> None:
    """Print how many targets are found, and the false alarms before each in the full-wave lane."""
    table = table.assign(found=table["false_alarms"] <= ALLOWED)
    worlds = ["full wave", *SURFACES, WITH_OWN_ECHOES]
    print(
        "\nTargets found at one false alarm, of 3: mean over twins (95 % of them; twins with 0, 1, 2, 3)\n"
    )
    print("| detector | " + " | ".join(worlds) + " |")
    print("|---" * (len(worlds) + 1) + "|")
    for detector, rows in table.groupby("detector", sort=False):
        cells = []
        for world in worlds:
            some = rows[rows["world"] == world]
            cells.append(of_three(some.set_index("seed")["found"]) if len(some) else "")
        print(f"| {detector} | " + " | ".join(cells) + " |")
    print(
        "\nFalse alarms before each target of the full-wave lane; in the twins the median and how often found at one\n"
    )
    print(
        "| detector | full wave | twins, mine 1 | mine 2 | mine 3 | mine 2 behind, m |\n|---|---|---|---|---|---|"
    )
    for detector, rows in table.groupby("detector", sort=False):
        real = rows[rows["world"] == "full wave"].set_index("target")["false_alarms"]
        cells = [", ".join("never" if np.isinf(count) else f"{count:.0f}" for count in real)]
        twins = rows[rows["world"] == OWN]
        for target in real.index:
            counts = twins.loc[twins["target"] == target, "false_alarms"]
            k = int((counts <= ALLOWED).sum())
            low, high = clopper_pearson(k, len(counts))
            cells.append(f"{k} of {len(counts)} ({low:.2f} to {high:.2f})" if len(counts) else "")
        second = real.index[1]
        real_behind = rows.loc[
            (rows["world"] == "full wave") & (rows["target"] == second), "behind"
        ].item()
        behind = twins.loc[twins["target"] == second, "behind"].dropna()
        spread = ""
        if len(behind):
            low, middle, high = np.percentile(behind, [2.5, 50, 97.5])
            spread = f"; twins {middle:.2f} ({low:.2f} to {high:.2f})"
        cells.append(f"{real_behind:.2f}{spread}")
        print(f"| {detector} | " + " | ".join(cells) + " |")


def report_signatures(alone: pd.DataFrame, lane: pd.DataFrame, clutter: pd.DataFrame) -> None:
    """Print what experiment 3 measured."""
    print("\n| echo of a body alone, 18 cases | least | median | most |\n|---|---|---|---|")
    for column in ("coherence", "level_db", "share_full_wave", "share_simulated"):
        low, middle, high = np.percentile(alone[column], [0, 50, 100])
        print(f"| {column} | {low:.3f} | {middle:.3f} | {high:.3f} |")
    for name in ("coherence", "level_db"):
        columns = [
            column for column in alone if column.startswith(f"{name}_") and column != "level_db"
        ]
        low, high = alone[columns].min().min(), alone[columns].max().max()
        print(f"| {name}, single polarization and sub-band | {low:.3f} | | {high:.3f} |")
    print(
        "\nChips at the mines and their own simulated echoes, over scans (twins: median and central 95 %)\n"
    )
    print("| early echoes | target | quantity | full wave, scans | twins |\n|---|---|---|---|---|")
    for (out, target), rows in lane.groupby(["early_out", "target"]):
        for name in ("coherence", "by_chance_95", "level_db", "level_db_HH", "level_db_VV"):
            real = rows.loc[rows["world"] == "full wave", name]
            low, middle, high = np.percentile(rows.loc[rows["world"] == OWN, name], [2.5, 50, 97.5])
            scans = ", ".join(f"{value:.2f}" for value in real)
            print(
                f"| {'out' if out else 'in'} | {target} | {name} | {scans} | {middle:.2f} ({low:.2f} to {high:.2f}) |"
            )
    print("\nGround away from targets, full wave less twins (dB; range over twins)\n")
    print(
        "| early echoes | polarization | "
        + " | ".join(BANDS)
        + " |\n|---|---|"
        + "---|" * len(BANDS)
    )
    for (out, label), rows in clutter.groupby(["early_out", "polarization"]):
        cells = []
        for band in BANDS:
            some = rows[rows["band"] == band]
            real = some.loc[some["world"] == "full wave", "level_db"].item()
            twins = some.loc[some["world"] == OWN, "level_db"]
            cells.append(
                f"{real - twins.mean():.1f} ({real - twins.max():.1f} to {real - twins.min():.1f})"
            )
        print(f"| {'out' if out else 'in'} | {label} | " + " | ".join(cells) + " |")


def draw(table: pd.DataFrame, lane: pd.DataFrame, clutter: pd.DataFrame, path: Path) -> None:
    """Draw what is found, the level of the ground, and how chips at the mines correlate."""
    figure = Figure(figsize=(13, 4.4), layout="constrained")
    left, middle, right = figure.subplots(1, 3, width_ratios=(1.5, 1, 1))
    rows = [
        ("C_HH", "C_HH"),
        ("C_HH, early echoes out", "C_HH, early out"),
        ("fused", "fused"),
        ("fused, early echoes out", "fused, early out"),
        (
            "fused in the sub-bands of miniature, early echoes out",
            "fused, early out,\nwide sub-bands",
        ),
    ]
    marks = {
        OWN: ("o", "C0", 0.2),
        WITH_OWN_ECHOES: ("s", "C1", 0.0),
        "full wave": ("*", "k", -0.2),
    }
    names = {OWN: "twins", WITH_OWN_ECHOES: "twins with the early echoes", "full wave": "full wave"}
    for world, (marker, colour, shift) in marks.items():
        for place, (detector, _) in enumerate(rows):
            some = table[(table["world"] == world) & (table["detector"] == detector)]
            found = (some["false_alarms"] <= ALLOWED).groupby(some["seed"]).sum()
            for number, count in found.value_counts().items():
                size = 130 if world == "full wave" else 12 + 150 * count / len(found)
                label = names[world] if place == 0 and number == found.mode()[0] else None
                left.scatter(
                    number, -place + shift, s=size, marker=marker, color=colour, label=label
                )
    left.set_yticks([-place for place in range(len(rows))], [label for _, label in rows])
    left.set(xlim=(-0.4, 3.4), xticks=range(4), xlabel="mines found of 3, at one false alarm")
    left.grid(axis="x", alpha=0.3)
    left.legend(
        loc="upper center", bbox_to_anchor=(0.4, 1.16), ncols=3, fontsize=8, markerscale=0.6
    )

    bands = list(BANDS)
    labels = ["0.45-0.6", "0.6-0.8", "0.8-1.05", "0.45-1.5"]
    co = clutter[clutter["polarization"] == "HH"]
    for out, style in ((False, "k*-"), (True, "k*--")):
        real = co[(co["world"] == "full wave") & (co["early_out"] == out)].set_index("band")[
            "level_db"
        ]
        label = "full wave, early out" if out else "full wave"
        middle.plot(range(len(bands)), real[bands], style, ms=9, label=label)
    twins = co[(co["world"] == OWN) & ~co["early_out"]].groupby("band")["level_db"]
    middle.fill_between(
        range(len(bands)),
        twins.min()[bands],
        twins.max()[bands],
        color="C0",
        alpha=0.5,
        label="twins",
    )
    middle.set_xticks(range(len(bands)), labels)
    middle.set(xlabel="sub-band (GHz)", ylabel="HH of the ground (dB, absolute)")
    middle.legend(fontsize=8)
    middle.grid(alpha=0.3)

    targets = sorted(lane["target"].unique())
    for place, target in enumerate(targets):
        some = lane[lane["target"] == target]
        twins = some.loc[(some["world"] == OWN) & ~some["early_out"], "coherence"]
        low, mid, high = np.percentile(twins, [2.5, 50, 97.5])
        right.errorbar(place, mid, [[mid - low], [high - mid]], fmt="o", color="C0", capsize=4,
                       label=None if place else "twins, 95 %")  # fmt: skip
        for out, shift, fill in ((False, 0.15, "none"), (True, 0.3, "k")):
            real = some.loc[
                (some["world"] == "full wave") & (some["early_out"] == out), "coherence"
            ]
            label = None if place else ("full wave, early out" if out else "full wave, scans")
            right.plot([place + shift] * len(real), real, "k*", mfc=fill, ms=9, ls="", label=label)
        chance = some.loc[some["world"] == OWN, "by_chance_95"].median()
        right.plot(
            [place - 0.2, place + 0.4],
            [chance] * 2,
            "C7:",
            label=None if place else "by chance (95 %)",
        )
    right.set_xticks(range(len(targets)), ["metal,\n1.5 cm", "metal,\n6 cm", "plastic,\n3 cm"])
    right.set(ylim=(0, 1.02), ylabel="coherence with the mine's simulated echo")
    right.legend(fontsize=8, loc="lower left")
    right.grid(alpha=0.3)
    figure.savefig(path, dpi=85, metadata={"Software": None})


def main() -> None:
    """Run the experiments, write the tables and draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--twins", type=int, default=40)
    parser.add_argument(
        "--known", type=int, default=24, help="training lanes of the proving ground"
    )
    parser.add_argument(
        "--summary", action="store_true", help="tables and figure of what is in OUT"
    )
    parser.add_argument("--figure", type=Path)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    if not given.summary:
        for name, rows in measure(given.twins, given.known).items():
            table = pd.DataFrame(rows)
            table.to_csv(given.out / f"{name}.csv", index=False, float_format="%.6g")
    tables = {}
    for name in ("found", "by-difference", "in-the-lane", "ground"):
        tables[name] = read_columns(given.out / f"{name}.csv")
    report_found(tables["found"])
    report_signatures(tables["by-difference"], tables["in-the-lane"], tables["ground"])
    if given.figure is not None:
        draw(tables["found"], tables["in-the-lane"], tables["ground"], given.figure)


def measure(twins: int, known_count: int) -> dict[str, list[dict]]:
    """Run the experiments and return the rows of their tables."""
    known = known_lanes(known_count)
    found: list[dict] = []
    experiment_lanes(twins, known, found)
    experiment_covariance(twins, known, found)
    alone = by_difference()
    lane, ground, (scale, spread) = in_the_lane(max(twins // 2, 2))
    print(f"scale {scale:.4g} of the data by the direct wave, {spread:.3f} dB rms over pairs")
    return {"found": found, "by-difference": alone, "in-the-lane": lane, "ground": ground}


if __name__ == "__main__":
    main()
