"""Compute what the figures of the theory pages show: widths, shifts, levels, images and scores."""

import numpy as np
import pandas as pd

from flgpr.detect import DeflectionDetector, NeymanPearsonDetector
from flgpr.imaging import ImagingOperator
from flgpr.model import SPEED_OF_LIGHT, Grid, Lane, load_sensor
from flgpr.model.refraction import reflection
from flgpr.recipe.schema import load_recipe
from flgpr.simulate import Scene, Simulator
from flgpr.simulate.bodies.rims import cylinder, rim_amplitude, visible_rims
from flgpr.simulate.bodies.signature import packaged_table
from flgpr.simulate.bodies.targets import node_weights

BANDS = {
    name: band for name, band in load_recipe("wang2007").image.subbands.items() if name != "F0"
}


def half_power_widths(array="sri-array", band=(0.75e9, 1.35e9), distance=12.0):
    """Half-power widths of a point's image on the ground.

    Parameters
    ----------
    array : str
        Sensor preset.
    band : (lo, hi)
        Hz.
    distance : float
        Of the point, ahead of the array, m.

    Returns
    -------
    down, across : float
        Measured on the image, m.
    down_formula, across_formula : float
        0.886 c/2B over the cosine of the grazing angle; 0.886 λR/2D with D the width of the phase
        centres, m.
    """
    sensor = load_sensor(array)
    tx, rx = sensor.pairs()
    frequency = sensor.tones.axis()
    up = np.array([0.0, 0.0, sensor.height])
    point = np.array([0.0, distance, 0.0])
    lines = [
        point + np.outer(np.linspace(-1.5, 1.5, 1201), axis) for axis in ((0, 1, 0), (1, 0, 0))
    ]
    echo = ImagingOperator(frequency, tx + up, rx + up, point[None], [band]).forward(
        np.ones((1, 1, 1), np.complex64)
    )
    image = np.abs(
        ImagingOperator(frequency, tx + up, rx + up, np.stack(lines), [band]).adjoint(echo)[0, 0]
    )
    measured = [float(np.sum(line > line.max() / np.sqrt(2)) * 3.0 / 1200) for line in image]
    slant = np.hypot(distance, sensor.height)
    centres = (tx[:, 0] + rx[:, 0]) / 2
    wavelength = 2 * SPEED_OF_LIGHT / sum(band)
    down = 0.886 * SPEED_OF_LIGHT / (2 * (band[1] - band[0])) * slant / distance
    return *measured, down, 0.886 * wavelength * slant / (2 * np.ptp(centres))


def mine_cuts(depth=0.05, site="arid-sand", distance=12.0, kind="metal", bands=None):
    """Range cuts through a mine without clutter, HH and VV.

    Returns
    -------
    offset : (sample,) ndarray
        Ground range from the mine's centre, m.
    cuts : (polarization, subband, sample) ndarray
        Magnitudes.
    """
    quiet = {"rocks": 0.0, "bushes": 0.0, "posts": 0.0, "patches": 0.0}
    scene = Scene(
        site=site,
        length=1.0,
        x_min=-1,
        x_max=1,
        clutter=quiet,
        surface={"echo": False, "phase_screen": False},
        targets=[{"kind": kind, "x": 0.0, "y": 0.5, "depth": depth}],
        track={"positions": [0.5 - distance]},
    )
    sensor = load_sensor("sri-array")
    simulator = Simulator(scene, sensor, 1, errors=False)
    data = simulator.scan(0)[: len(("HH", "VV"))]
    tx, rx = sensor.pairs()
    up = np.array([0.0, 0.0, sensor.height])
    offset = np.linspace(-1.0, 1.4, 241)
    points = np.column_stack([0 * offset, distance + offset, 0 * offset])
    chosen = list((bands or BANDS).values())
    operator = ImagingOperator(sensor.tones.axis(), tx + up, rx + up, points, chosen, window="hann")
    return offset, np.abs(operator.adjoint(data))


def focused_shift(depth, permittivity, distance, height):
    """Where a buried point focuses when imaged as if there were no soil, beyond its place, m."""
    sensor = load_sensor("sri-array")
    tx, rx = (antennas + np.array([0.0, 0.0, height]) for antennas in sensor.pairs())
    frequency = np.arange(0.75e9, 1.35e9, 10e6)
    point = np.array([[0.0, distance, -depth]])
    echo = ImagingOperator(
        frequency, tx, rx, point, half_space=permittivity, method="direct"
    ).forward(np.ones((1, 1, 1)))
    y = np.arange(-0.3, 1.0, 0.005)
    line = np.column_stack([0 * y, distance + y, 0 * y])
    image = np.abs(ImagingOperator(frequency, tx, rx, line, method="direct").adjoint(echo)[0, 0])
    return float(y[image.argmax()])


def edge_levels(permittivity, incidence):
    """Level of a buried disc's two flashes over physical optics without its obliquity, dB.

    Parameters
    ----------
    permittivity : float
        Of the soil.
    incidence : float
        Angle in air, rad.

    Returns
    -------
    dict
        "near H", "near V", "far H", "far V".
    """
    sine = np.sin(incidence) / np.sqrt(permittivity)
    k = 2 * np.pi * 1.05e9 / SPEED_OF_LIGHT * np.sqrt(permittivity)
    x = 2 * k * 0.16 * sine
    area = np.pi * 0.16**2
    wavelength = 2 * np.pi / k
    optics = 4 * np.pi * area**2 / wavelength**2 * (2 / x) ** 2 * (2 / (np.pi * x)) / 4
    levels = {}
    for rim in visible_rims(cylinder(0.16, 0.15), sine):
        if rim.drop == 0:
            size = np.abs(rim_amplitude(rim, k, sine))
            for letter, coefficient in (("H", rim.h), ("V", rim.v)):
                sigma = 4 * np.pi * (size * coefficient) ** 2
                levels[f"{'near' if rim.is_near else 'far'} {letter}"] = float(
                    10 * np.log10(sigma / optics)
                )
    return levels


def body_levels(body, frequency, permittivity=3.1 - 0.062j, depth=0.05, incidence=67.0):
    """Backscatter of a buried body from its signature.

    Parameters
    ----------
    body : str
        Packaged body.
    frequency : (n,) ndarray
        Hz.
    permittivity : complex
        Of the soil.
    depth : float
        Of the body's top, m.
    incidence : float
        Angle in air, degrees.

    Returns
    -------
    hh, vv : (n,) ndarray
        The amplitude |F|, dB re 1 m.
    """
    table = packaged_table(body)
    frequency = np.atleast_1d(np.asarray(frequency, dtype=float))
    found = table.at(frequency, np.full(frequency.size, permittivity), depth)
    weight = node_weights(np.sin(np.radians([incidence])), np.zeros(1), np.zeros(1), table.aspects)[
        :, :, :, 0, 0
    ]
    hh, vv = np.einsum("ast,astpf->pf", weight, found)[:2]
    return 20 * np.log10(np.abs(hh)), 20 * np.log10(np.abs(vv))


def scan_images(seed=5):
    """Images of one lane: bare ground without errors, and with a mine on it and the sensor's errors.

    Returns
    -------
    grid : Grid
        Pixels in the scan frame.
    bare : (subband, y, x) ndarray of complex
        F1 and F4, HH, no errors.
    signed : (scan, y, x) ndarray of complex
        Eight scans with errors, F1, HH.
    """
    quiet = {"rocks": 0.0, "bushes": 0.0, "posts": 0.0, "patches": 0.0}
    scene = Scene(
        site="arid-sand",
        length=30.0,
        clutter=quiet,
        surface={"density": 60.0},
        targets=[{"kind": "metal", "x": 0.5, "y": 14.0, "depth": -0.15}],
        track={"positions": [0.0, 1.7, 3.1, 5.2, 6.6, 8.4, 10.1, 11.7]},
    )
    sensor = load_sensor("sri-array")
    tx, rx = sensor.pairs()
    up = np.array([0.0, 0.0, sensor.height])
    grid = Grid.spanning((-4.0, 4.0), (7.0, 22.0), 0.1)
    operator = ImagingOperator(
        sensor.tones.axis(), tx + up, rx + up, grid.points(), [BANDS["F1"], BANDS["F4"]]
    )
    made = []
    for errors in (False, True):
        one = scene if errors else scene.model_copy(update={"targets": ()})
        simulator = Simulator(one, sensor, seed, errors=errors)
        scans = range(len(simulator)) if errors else (0,)
        made.append(
            np.stack([operator.adjoint(np.nan_to_num(simulator.scan(k)[:1]))[0] for k in scans])
        )
    return grid, made[0][0], made[1][:, 0]


def oh1992(frequency, sine, permittivity, rms_height):
    """HH and VV of bare soil by Oh, Sarabandi & Ulaby 1992, fitted to L, C and X band at ks = 0.1 to 6."""
    ks = 2 * np.pi * frequency / SPEED_OF_LIGHT * rms_height
    r_h, r_v = reflection(sine, 1.0, permittivity)
    nadir = np.abs((1 - np.sqrt(permittivity)) / (1 + np.sqrt(permittivity))) ** 2
    p = (1 - (2 * np.arcsin(sine) / np.pi) ** (1 / (3 * nadir)) * np.exp(-ks)) ** 2
    growth = 0.7 * (1 - np.exp(-0.65 * ks**1.8)) * (1 - sine**2) ** 1.5
    vv = growth * (np.abs(r_h) ** 2 + np.abs(r_v) ** 2) / np.sqrt(p)
    return p * vv, vv


def deflection_samples(n_target=14, n_test=4000, seed=3):
    """Whitened range cuts of mines whose double hump varies, and of clutter.

    Returns
    -------
    train : (n_target, 56) ndarray of complex
        Mines to learn from.
    target, clutter : (n_test, 56) ndarray of complex
        To test on.
    """
    rng = np.random.default_rng(seed)
    place = np.arange(28)

    def draw(n):
        humps = [np.exp(-0.5 * ((place - c) / 2.0) ** 2) for c in (7, 21)]
        size = rng.normal(size=(n, 4)) + 1j * rng.normal(size=(n, 4))
        size += np.array([0.9, 0.3, 0.7, 0.9])
        cut = np.concatenate([size[:, :2] @ np.array(humps), size[:, 2:] @ np.array(humps)], axis=1)
        return 0.8 * cut + noise(n)

    def noise(n):
        return (rng.normal(size=(n, 56)) + 1j * rng.normal(size=(n, 56))) / np.sqrt(2)

    return draw(n_target), draw(n_test), noise(n_test)


def detector_scores(seed=3):
    """Score made-up cuts by every detector; returns name, (target, clutter) scores."""
    train, target, clutter = deflection_samples(seed=seed)
    scores = {}
    for name, machine in (
        ("deflection, rank 3", DeflectionDetector(rank=3)),
        ("deflection, rank 1", DeflectionDetector(rank=1)),
        ("Neyman-Pearson, rank 3", NeymanPearsonDetector(rank=3)),
    ):
        machine.fit(train)
        scores[name] = machine.decision_function(target), machine.decision_function(clutter)
    scores["energy of the brightest sample"] = tuple(
        np.abs(x).max(axis=1) for x in (target, clutter)
    )
    return scores


def roc_example(seed=2):
    """Twenty mines and false alarms on a lane; returns alarms, truth and lane."""
    rng = np.random.default_rng(seed)
    lane = Lane(-2.0, 2.0, 0.0, 100.0)
    truth = pd.DataFrame({"x": rng.uniform(-1.5, 1.5, 20), "y": np.linspace(3, 97, 20)})
    truth = truth.assign(kind=["metal", "plastic"] * 10, target_id=[f"T{i}" for i in range(20)])
    truth["depth"] = 0.05
    level = np.where(truth.kind == "metal", 3.0, 1.5) + rng.normal(0, 1, 20)
    near = pd.DataFrame({"x": truth.x + 0.2, "y": truth.y - 0.2, "confidence": level})
    far = pd.DataFrame(
        {
            "x": rng.uniform(-2, 2, 60),
            "y": rng.uniform(0, 100, 60),
            "confidence": rng.normal(0, 1, 60),
        }
    )
    return pd.concat([near, far], ignore_index=True), truth, lane
