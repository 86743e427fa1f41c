"""What an array will see before it is built: point spread, resolution, lobes, signal to clutter over the ground."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr.chain.progress import Track, silent
from flgpr.design.point_spread import PointSpread, ground_plane
from flgpr.design.signal_to_clutter import (
    GroundModel,
    Viewing,
    expected_signal_to_clutter,
    ground_model,
)
from flgpr.imaging import ScanImager
from flgpr.model import SPEED_OF_LIGHT, Grid, Sensor
from flgpr.simulate import Scene, Simulator, sites

FloatArray = NDArray[np.float64]
KINDS = ("metal", "plastic")
BODIES = {"metal": "metal-at", "plastic": "plastic-at"}
"""Packaged bodies that the kinds stand for."""
_LOOKS = 4  # bare stretches of ground whose mean power is the clutter
_CORE = 2.5  # half-power widths around the peak that do not count as a lobe


@dataclass(frozen=True)
class Question:
    """What is asked of an array."""

    band: tuple[float, float] | None = None  #: tones that make the image, Hz; None takes all
    window: str = "hann"
    site: str = "arid-sand"  #: packaged site whose soil and surface the mines lie in
    depth: float = 0.05  #: depth of the mines' top, m
    rms_height: float | None = None  #: of the surface, m; None takes the site's


@dataclass
class Design:
    """What an array will see, in SI units.

    Maps are (y, x) over ground positions ``x``, ``y`` in m ahead of and across the array, ``ratio`` over its own.
    ``down`` and ``cross`` are the half-power widths of the point spread along y and x, m, NaN where no half-power point
    was met; ``lobes`` the place and level of the highest lobe at each distance; ``responses`` the ground around a point
    at each distance as (y, x, power), dB below its peak, and ``close`` the same with offsets from the point; ``ratio``
    the simulated signal to clutter of a mine by kind and polarization, dB; ``expected`` that by formula at the middle
    distance straight ahead, as :func:`flgpr.design.expected_signal_to_clutter` gives it, empty where ``not_expected``
    says why there is none.
    """

    sensor: Sensor
    facts: dict[str, float]
    x: FloatArray
    y: FloatArray
    down: FloatArray
    cross: FloatArray
    lobes: list[dict[str, float]] = field(default_factory=list)
    responses: dict[float, tuple[FloatArray, FloatArray, FloatArray]] = field(default_factory=dict)
    close: dict[float, tuple[FloatArray, FloatArray, FloatArray]] = field(default_factory=dict)
    ratio: dict[tuple[str, str], FloatArray] = field(default_factory=dict)
    ratio_x: FloatArray = field(default_factory=lambda: np.empty(0))
    ratio_y: FloatArray = field(default_factory=lambda: np.empty(0))
    distance: float = 0.0
    expected: pd.DataFrame = field(default_factory=pd.DataFrame)
    not_expected: str = "it was not asked for"


def study(sensor: Sensor, question: Question | None = None, track: Track = silent) -> Design:
    """Find out what an array will see, on maps of its footprint, clipped to 4 m across."""
    asked = question or Question()
    if asked.site not in sites():
        raise ValueError(f"site must be one of {', '.join(sites())}, got {asked.site!r}")
    ground = ground_model(asked.site, rms_height=asked.rms_height)
    spread = PointSpread(sensor, asked.band, asked.window)
    x_min, x_max, y_min, y_max = sensor.footprint
    near = max(y_min, 1.2 * sensor.height)
    x = np.linspace(max(x_min, -4.0), min(x_max, 4.0), 9)
    y = np.linspace(near, y_max, 13)
    down = np.empty((y.size, x.size))
    cross = np.empty((y.size, x.size))
    for i, j in track([*np.ndindex(y.size, x.size)], f"{sensor.name}: resolution", y.size * x.size):
        down[i, j], cross[i, j] = spread.widths([x[j], y[i], 0.0])
    design = Design(sensor, _facts(sensor, spread), x, y, down, cross)
    middle = (x[0] + x[-1]) / 2
    distances = [float(y[k]) for k in (1, y.size // 2, y.size - 2)]
    for distance in track(distances, f"{sensor.name}: point spread", len(distances)):
        source = np.array([middle, distance, 0.0])
        design.close[distance] = _close(spread, source)
        design.responses[distance] = _over_ground(spread, source, sensor)
        design.lobes.append(_highest_lobe(spread, source, design.responses[distance]))
    _simulate_ratio(design, sensor, ground, asked, track)
    _expect(design, ground, asked)
    return design


def expected_in_words(design: Design) -> str:
    """Tell in a sentence by how much mines are expected to stand above the clutter."""
    if design.expected.empty:
        return f"{design.sensor.name}: no signal to clutter by formula, for {design.not_expected}."
    first = design.expected.iloc[0]
    mines = []
    for kind, body in BODIES.items():
        rows = design.expected[design.expected["body"] == body]
        levels = zip(rows["signal_to_clutter_db"], rows["polarization"], strict=True)
        mines.append(f"a {kind} mine {' and '.join(_level_in_words(*level) for level in levels)}")
    return (
        f"{design.sensor.name}, {design.distance:.0f} m ahead, {100 * first['depth']:.3g} cm deep in {first['ground']} "
        f"with a surface of {1000 * first['rms_height']:.3g} mm rms: against the mean clutter the image is expected to "
        f"show {' and '.join(mines)}."
    )


def _level_in_words(level: float, polarization: str) -> str:
    if round(level) == 0:
        return f"level with it in {polarization}"
    side = "stronger" if level > 0 else "weaker"
    return f"{abs(round(level))} dB {side} in {polarization}"


def _expect(design: Design, ground: GroundModel, asked: Question) -> None:
    """Find the signal to clutter by formula at the middle distance, or why there is none."""
    design.distance = float(design.y[design.y.size // 2])
    bodies = list(BODIES.values())
    bands = None if asked.band is None else {"all": asked.band}
    viewing = Viewing(distance=design.distance, subbands=bands, window=asked.window)
    try:
        design.expected = expected_signal_to_clutter(
            design.sensor, ground, bodies, [asked.depth], viewing
        )
    except ValueError as error:
        design.not_expected = str(error)


def _facts(sensor: Sensor, spread: PointSpread) -> dict[str, float]:
    tx, rx = sensor.pairs()
    midpoints = np.unique(np.round((tx + rx)[:, 0] / 2, 6))
    gap = float(np.diff(midpoints).max()) if midpoints.size > 1 else 0.0
    shortest = SPEED_OF_LIGHT / spread.tones[-1]
    sine = shortest / (2 * gap) if gap > 0 else math.inf
    return {
        "transmitters": float(len(np.unique(tx, axis=0))),
        "receivers": float(len(np.unique(rx, axis=0))),
        "pairs": float(len(tx)),
        "aperture": float(np.ptp(midpoints)),
        "height": sensor.height,
        "lowest": float(spread.tones[0]),
        "highest": float(spread.tones[-1]),
        "tones": float(spread.tones.size),
        "unambiguous_range": SPEED_OF_LIGHT / (2 * sensor.tones.step),
        "widest_gap": gap,
        "grating_angle": math.asin(sine) if sine < 1 else math.nan,
    }


def _close(spread: PointSpread, source: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    down, cross = spread.expected_widths(source)
    y = np.linspace(-5, 5, 161) * down
    x = np.linspace(-5, 5, 161) * cross
    return y, x, _decibels(spread(ground_plane(x + source[0], y + source[1]), source))


def _over_ground(
    spread: PointSpread, source: FloatArray, sensor: Sensor
) -> tuple[FloatArray, FloatArray, FloatArray]:
    x_min, x_max, y_min, y_max = sensor.footprint
    down, cross = spread.expected_widths(np.array([0.0, max(y_min, 1.2 * sensor.height), 0.0]))
    y = np.linspace(y_min, y_max, min(400, math.ceil((y_max - y_min) / (0.4 * down))))
    x = np.linspace(x_min, x_max, min(400, math.ceil((x_max - x_min) / (0.4 * cross))))
    return y, x, _decibels(spread(ground_plane(x, y), source))


def _highest_lobe(
    spread: PointSpread, source: FloatArray, response: tuple[FloatArray, FloatArray, FloatArray]
) -> dict[str, float]:
    y, x, power = response
    down, cross = (
        w if math.isfinite(w) else e
        for w, e in zip(spread.widths(source), spread.expected_widths(source), strict=True)
    )
    core = (np.abs(y - source[1])[:, None] < _CORE * down) & (np.abs(x - source[0]) < _CORE * cross)
    outside = np.where(core, -np.inf, power)
    i, j = np.unravel_index(outside.argmax(), outside.shape)
    return {
        "distance": float(source[1]),
        "down": down,
        "cross": cross,
        "level": float(outside[i, j]),
        "x": float(x[j] - source[0]),
        "y": float(y[i] - source[1]),
    }


def _decibels(amplitude: FloatArray) -> FloatArray:
    return np.asarray(20 * np.log10(np.maximum(amplitude, 1e-6)))


def _simulate_ratio(
    design: Design, sensor: Sensor, ground: GroundModel, asked: Question, track: Track
) -> None:
    """Simulate single mines and bare ground, image both, and divide peak by mean power."""
    still = sensor.model_copy(
        update={"polarization": tuple(p for p in sensor.polarization if p[0] == p[1])}
    )
    if not still.polarization:
        return
    band = {"band": asked.band or (float(sensor.tones.axis()[0]), float(sensor.tones.axis()[-1]))}
    design.ratio_y = np.linspace(design.y[0] + 0.5, design.y[-1] - 1.0, 7)
    design.ratio_x = np.linspace(design.x[0], design.x[-1], 5)
    clutter = _clutter(design, still, ground, asked, band)
    steps = [(kind, column) for kind in KINDS for column in range(design.ratio_x.size)]
    for kind, column in track(steps, f"{sensor.name}: signal to clutter", len(steps)):
        peaks = _peaks(design, still, ground, asked, band, kind, float(design.ratio_x[column]))
        for p, label in enumerate(still.polarization):
            grid = design.ratio.setdefault(
                (kind, label), np.empty((design.ratio_y.size, design.ratio_x.size))
            )
            grid[:, column] = 10 * np.log10(peaks[:, p] / clutter[p, :, column])


def _bare(ground: GroundModel, surface: dict[str, Any], **parts: Any) -> Scene:
    """Make a lane of a ground's soil and surface and nothing else but ``parts``."""
    own = ground.surface.model_copy(update=surface)
    return Scene.model_validate({"soil": ground.soil, "surface": own} | parts)


def _clutter(
    design: Design,
    sensor: Sensor,
    ground: GroundModel,
    asked: Question,
    band: dict[str, tuple[float, float]],
) -> FloatArray:
    """Mean power (polarization, y, x) of bare ground around every position of the ratio map."""
    apart = design.y[-1] + 60.0
    scene = _bare(
        ground,
        {"texture_shape": None},
        length=_LOOKS * apart,
        track={"positions": tuple(k * apart for k in range(_LOOKS))},
    )
    run = Simulator(scene, sensor, 1, errors=False).run()
    reach_y = 1.0
    reach_x = 1.0
    grid = Grid.spanning(
        (float(design.ratio_x[0] - reach_x), float(design.ratio_x[-1] + reach_x)),
        (float(design.ratio_y[0] - reach_y), float(design.ratio_y[-1] + reach_y)),
        0.15,
    )
    power = np.mean(
        [np.abs(image.values[:, 0]) ** 2 for image in ScanImager(run, grid, band, asked.window)],
        axis=0,
    )
    out = np.empty((power.shape[0], design.ratio_y.size, design.ratio_x.size))
    for i, j in np.ndindex(*out.shape[1:]):
        rows = np.abs(grid.y - design.ratio_y[i]) <= reach_y
        columns = np.abs(grid.x - design.ratio_x[j]) <= reach_x
        out[:, i, j] = power[:, rows][:, :, columns].mean(axis=(1, 2))
    return out


def _peaks(
    design: Design,
    sensor: Sensor,
    ground: GroundModel,
    asked: Question,
    band: dict[str, tuple[float, float]],
    kind: str,
    x: float,
) -> FloatArray:
    """Peak power (y, polarization) in the image of a mine on its own at a cross-track place, from every distance."""
    far = float(design.ratio_y[-1]) + 5.0
    scene = _bare(
        ground,
        {"phase_screen": False},
        length=far + 10.0,
        targets=[{"kind": kind, "x": x, "y": far, "depth": asked.depth}],
        track={"positions": tuple(far - float(y) for y in design.ratio_y)},
    )
    run = Simulator(scene, sensor, 1, errors=False).run(bodies=True)
    peaks = np.empty((design.ratio_y.size, len(sensor.polarization)))
    for scan, distance in enumerate(design.ratio_y):
        spread = min(float(np.nanmin(design.down)), float(np.nanmin(design.cross))) / 3
        grid = Grid.spanning(
            (x - 0.5, x + 0.5), (float(distance) - 0.5, float(distance) + 0.8), max(spread, 0.01)
        )
        image = ScanImager(run.isel(scan=[scan]), grid, band, asked.window).image(0)
        peaks[scan] = (np.abs(image.values[:, 0]) ** 2).max(axis=(1, 2))
    return peaks
