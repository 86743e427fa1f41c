"""Experiment 3: echoes of bodies, alone and in the lane, full wave against simulated."""

from __future__ import annotations

import itertools

import numpy as np
import xarray as xr

from flgpr.clutter import early_basis, subtract_early
from flgpr.imaging import ImagingOperator, ScanImager
from flgpr.method.imaged_run import ImagedRun
from flgpr.model import SPEED_OF_LIGHT, Grid, lane_to_scan, load_sensor
from flgpr.simulate import Simulator
from flgpr.stages.body_signatures import Bodies, Imaging, signatures
from full_wave_causes.lanes import LANE, OWN, SURFACES, LaneData, full_wave, twin, twin_scene
from full_wave_causes.recipes import CLEAR, contrast_recipe, fused_recipe
from simulate import fullwave_difference as difference

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


def compared(one: np.ndarray, other: np.ndarray, name: str = "") -> dict[str, float]:
    """Return coherence and level of an array over another, under names that end so."""
    level = decibels(np.linalg.norm(one) / np.linalg.norm(other))
    return {f"coherence{name}": coherence(one, other), f"level_db{name}": level}


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
            **compared(full, simulated),
            "share_full_wave": share(full, vectors),
            "share_simulated": share(simulated, vectors),
        }
        for number, label in enumerate(case.polarization):
            if label in ("HH", "VV"):
                for band, low in enumerate(list(BANDS)[:CHIP_BANDS]):
                    name = f"_{label}_{low}"
                    row |= compared(full[number, band], simulated[number, band], name)
        rows.append(row)
    return rows


def directions(case) -> np.ndarray:
    """Return the directions (12, value) of the metal mines' signatures, for a case's array."""
    settings = fused_recipe().map.settings
    sensor = difference.sensor(case)
    bodies = Bodies(settings.kinds, settings.depths, settings.soils, settings.copies, settings.step)
    imaging = Imaging(
        grid=Grid.spanning((-0.6, 0.6), (1.2, 2.6), 0.025),
        subbands=tuple(BANDS.items())[:CHIP_BANDS],
        polarizations=tuple(case.polarization),
        window="hann",
        tolerance=1e-4,
        pixels=tuple(map(tuple, CHIP[:, :2])),
        limits=(-0.5, 0.5),
        tones=tuple(sensor.tones.axis().tolist()),
    )
    chips, _ = signatures(bodies, sensor, imaging)
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
    setup = ImagedRun(real.run, contrast_recipe(early=True), LANE, explains=False)
    path = setup.clutter_stages["clutter.early"].notes()["early_path"]
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
                row = head | {"target": target.target_id, "scan": scan} | compared(chip, echo)
                row["by_chance_95"] = float(np.quantile(by_chance, 0.95))
                for label in ("HH", "VV"):
                    number = labels.index(label)
                    row |= compared(chip[number], echo[number], f"_{label}")
                rows.append(row)
        power = np.mean(np.concatenate(ground), axis=0)
        for number, label in enumerate(labels):
            for band, name in enumerate(BANDS):
                level = 10 * np.log10(power[number, band])
                clutter.append(head | {"polarization": label, "band": name, "level_db": level})
    return rows, clutter, (scale, spread)
