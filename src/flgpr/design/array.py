"""Design of an array before it is built: point spread, resolution, lobes and signal to clutter."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
import xarray as xr

from flgpr.design.grounds import GroundModel, bare_lane, ground_model
from flgpr.design.point_spread import PointSpread, ground_plane
from flgpr.design.signal_to_clutter import Viewing, check_bodies, expected_signal_to_clutter
from flgpr.imaging import ScanImager
from flgpr.model import SPEED_OF_LIGHT, Grid, Sensor
from flgpr.model.ambiguity import phase_centre_gap
from flgpr.progress import Track, silent
from flgpr.simulate import sites
from flgpr.simulate.scene.scene import Target
from flgpr.types import FloatArray

Response = tuple[FloatArray, FloatArray, FloatArray]
KINDS = ("metal", "plastic")
BODIES = {"metal": "metal-at", "plastic": "plastic-at"}
"""Packaged bodies that the kinds stand for."""
_LOOKS = 4  # bare stretches of ground whose mean power is the clutter
_REACH = 1.0  # m around a position from which its clutter is taken
_CLUTTER_STEP = 0.15  # pixel of the clutter's image, m
_MOST_PIXELS = 400  # of a response over the ground, along an axis
_CORE = 2.5  # half-power widths around the peak that do not count as a lobe
# Least distance of the maps, in heights: an image starts where the array looks down at 40°.
_NEAREST = 1.2


@dataclass(frozen=True)
class Question:
    """Band, window, site and depth of the mines for which an array is studied."""

    band: tuple[float, float] | None = None  #: tones that make the image, Hz; None takes all
    window: str = "hann"
    site: str = "arid-sand"  #: packaged site whose soil and surface the mines lie in
    depth: float = 0.05  #: depth of the mines' top, m
    rms_height: float | None = None  #: of the surface, m; None takes the site's


@dataclass
class Design:
    """What an array will see, in SI units.

    Maps are (y, x) over ground positions across and ahead of the array, m.
    """

    sensor: Sensor
    facts: dict[str, float]  #: antennas, aperture, tones and the ranges that follow from them
    x: FloatArray  #: positions of the maps across, m
    y: FloatArray  #: positions of the maps ahead, m
    #: half-power widths of the point spread along y, m; NaN where there is no half-power point
    down: FloatArray
    cross: FloatArray  #: the same along x
    #: position and level of the highest lobe at each distance
    lobes: list[dict[str, float]] = field(default_factory=list)
    #: response over the ground to a point at each distance: y, x and power, dB below its peak
    responses: dict[float, Response] = field(default_factory=dict)
    #: the same close to the point, with offsets from it in place of y and x
    close: dict[float, Response] = field(default_factory=dict)
    #: simulated signal to clutter of a mine by kind and polarization, dB
    ratio: dict[tuple[str, str], FloatArray] = field(default_factory=dict)
    ratio_x: FloatArray = field(default_factory=lambda: np.empty(0))  #: positions of ``ratio``, m
    ratio_y: FloatArray = field(default_factory=lambda: np.empty(0))
    distance: float = 0.0  #: the middle distance, m
    #: signal to clutter by formula at the middle distance straight ahead, as
    #: :func:`flgpr.design.expected_signal_to_clutter` returns it; empty where there is none
    expected: pd.DataFrame = field(default_factory=pd.DataFrame)
    not_expected: str = "it was not asked for"  #: why ``expected`` is empty


def study(sensor: Sensor, question: Question | None = None, track: Track = silent) -> Design:
    """Study what an array will see, on maps of its footprint, clipped to 4 m across.

    Parameters
    ----------
    sensor : Sensor
        The array.
    question : Question, optional
        Band, window, site and depth of the mines.
    track : callable
        Shows the progress.

    Returns
    -------
    Design
        Maps and figures of the array.

    Raises
    ------
    ValueError
        If the site, the band or the window is not known, or the depth is out of range.
    """
    asked = question or Question()
    if asked.site not in sites():
        raise ValueError(f"site must be one of {', '.join(sites())}, got {asked.site!r}")
    check_bodies(list(BODIES.values()), [asked.depth])
    ground = ground_model(asked.site, rms_height=asked.rms_height)
    spread = PointSpread(sensor, asked.band, asked.window)

    x_min, x_max, y_min, y_max = sensor.ground_in_view
    nearest = max(y_min, _NEAREST * sensor.height)
    x = np.linspace(max(x_min, -4.0), min(x_max, 4.0), 9)
    y = np.linspace(nearest, y_max, 13)
    down = np.empty((y.size, x.size))
    cross = np.empty((y.size, x.size))
    pixels = list(np.ndindex(y.size, x.size))
    for i, j in track(pixels, f"{sensor.name}: resolution", len(pixels)):
        pixel = np.array([x[j], y[i], 0.0])
        down[i, j], cross[i, j] = spread.widths(pixel)
    design = Design(sensor, _facts(sensor, spread), x, y, down, cross)

    middle = (x[0] + x[-1]) / 2
    distances = [float(y[k]) for k in (1, y.size // 2, y.size - 2)]
    for distance in track(distances, f"{sensor.name}: point spread", len(distances)):
        source = np.array([middle, distance, 0.0])
        design.close[distance] = _close_response(spread, source)
        design.responses[distance] = _ground_response(spread, source, sensor)
        design.lobes.append(_highest_lobe(spread, source, design.responses[distance]))

    _simulate_ratio(design, ground, asked, track)
    _set_expected(design, ground, asked)
    return design


def expected_in_words(design: Design) -> str:
    """Return a sentence on how far mines are expected to stand above the clutter."""
    if design.expected.empty:
        return f"{design.sensor.name}: no signal to clutter by formula, for {design.not_expected}."
    first = design.expected.iloc[0]
    mines = []
    for kind, body in BODIES.items():
        rows = design.expected[design.expected["body"] == body]
        ratios = rows[["signal_to_clutter_db", "polarization"]]
        levels = [_level_in_words(*row) for row in ratios.itertuples(index=False)]
        mines.append(f"a {kind} mine {' and '.join(levels)}")
    return (
        f"{design.sensor.name}, {design.distance:.0f} m ahead, "
        f"{100 * first['depth']:.3g} cm deep in {first['ground']} "
        f"with a surface of {1000 * first['rms_height']:.3g} mm rms: "
        f"against the mean clutter the image is expected to show {' and '.join(mines)}."
    )


def _level_in_words(level: float, polarization: str) -> str:
    """Return a signal to clutter in dB as words."""
    if round(level) == 0:
        return f"level with it in {polarization}"
    side = "stronger" if level > 0 else "weaker"
    return f"{abs(round(level))} dB {side} in {polarization}"


def _set_expected(design: Design, ground: GroundModel, asked: Question) -> None:
    """Compute the signal to clutter by formula at the middle distance, or set why there is none."""
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
    """Return the numbers of antennas and tones, and the ranges and angles that follow from them."""
    tx, rx = sensor.pairs()
    gap = phase_centre_gap(tx, rx)

    # Two-way grating lobe: sin θ = λ/2d at the shortest wavelength; none where that is over one.
    shortest_wavelength = SPEED_OF_LIGHT / spread.tones[-1]
    sine = shortest_wavelength / (2 * gap) if gap > 0 else math.inf
    return {
        "transmitters": float(len(np.unique(tx, axis=0))),
        "receivers": float(len(np.unique(rx, axis=0))),
        "pairs": float(len(tx)),
        "aperture": float(np.ptp((tx + rx)[:, 0])) / 2,
        "height": sensor.height,
        "lowest": float(spread.tones[0]),
        "highest": float(spread.tones[-1]),
        "tones": float(spread.tones.size),
        "unambiguous_range": SPEED_OF_LIGHT / (2 * sensor.tones.step),
        "widest_gap": gap,
        "grating_angle": math.asin(sine) if sine < 1 else math.nan,
    }


def _close_response(spread: PointSpread, source: FloatArray) -> Response:
    """Return the response within five expected widths of a point."""
    down, cross = spread.expected_widths(source)
    y = np.linspace(-5, 5, 161) * down
    x = np.linspace(-5, 5, 161) * cross
    points = ground_plane(x + source[0], y + source[1])
    return y, x, _decibels(spread(points, source))


def _ground_response(spread: PointSpread, source: FloatArray, sensor: Sensor) -> Response:
    """Return the response over the footprint to a point."""
    x_min, x_max, y_min, y_max = sensor.ground_in_view
    # The response is narrowest at the nearest point: the step is set there.
    nearest = np.array([0.0, max(y_min, _NEAREST * sensor.height), 0.0])
    down, cross = spread.expected_widths(nearest)
    rows = math.ceil((y_max - y_min) / (0.4 * down))
    columns = math.ceil((x_max - x_min) / (0.4 * cross))
    y = np.linspace(y_min, y_max, min(_MOST_PIXELS, rows))
    x = np.linspace(x_min, x_max, min(_MOST_PIXELS, columns))
    points = ground_plane(x, y)
    return y, x, _decibels(spread(points, source))


def _highest_lobe(spread: PointSpread, source: FloatArray, response: Response) -> dict[str, float]:
    """Return position, level and distance of the highest lobe outside the core of the response."""
    y, x, power = response
    widths = spread.widths(source)
    expected = spread.expected_widths(source)
    down, cross = np.where(np.isfinite(widths), widths, expected).tolist()

    core_rows = np.abs(y - source[1]) < _CORE * down
    core_columns = np.abs(x - source[0]) < _CORE * cross
    core = core_rows[:, None] & core_columns
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
    """Return amplitudes in dB, at least -120."""
    return 20 * np.log10(np.maximum(amplitude, 1e-6))


@dataclass(frozen=True)
class _Simulation:
    """Simulated ground of a design, and the images that are made of it."""

    design: Design
    sensor: Sensor  #: the design's, with its copolar channels
    ground: GroundModel
    asked: Question

    def imager(self, run: xr.Dataset, grid: Grid) -> ScanImager:
        """Return the images of the asked band on a grid."""
        tones = self.sensor.tones.axis()
        band = self.asked.band or (float(tones[0]), float(tones[-1]))
        return ScanImager(run, grid, {"band": band}, self.asked.window)

    def clutter(self) -> FloatArray:
        """Return the mean power (polarization, y, x) of bare ground around positions."""
        ratio_x = self.design.ratio_x
        ratio_y = self.design.ratio_y
        # So far apart that no two looks share ground.
        apart = self.design.y[-1] + 60.0
        positions = tuple(k * apart for k in range(_LOOKS))
        surface = {"texture_shape": None}
        length = _LOOKS * apart
        run = bare_lane(self.ground, self.sensor, 1, length, positions, surface).run()

        x_edges = (float(ratio_x[0] - _REACH), float(ratio_x[-1] + _REACH))
        y_edges = (float(ratio_y[0] - _REACH), float(ratio_y[-1] + _REACH))
        grid = Grid.spanning(x_edges, y_edges, _CLUTTER_STEP)
        scan_power = [np.abs(image.values[:, 0]) ** 2 for image in self.imager(run, grid)]
        power = np.mean(scan_power, axis=0)

        clutter = np.empty((power.shape[0], ratio_y.size, ratio_x.size))
        for i, j in np.ndindex(*clutter.shape[1:]):
            rows = np.abs(grid.y - ratio_y[i]) <= _REACH
            columns = np.abs(grid.x - ratio_x[j]) <= _REACH
            clutter[:, i, j] = power[:, rows][:, :, columns].mean(axis=(1, 2))
        return clutter

    def peaks(self, kind: str, x: float) -> FloatArray:
        """Return the peak power (y, polarization) in the image of a mine, from every distance.

        ``x`` is its cross-track position, m.
        """
        distances = self.design.ratio_y.tolist()
        far = distances[-1] + 5.0
        positions = tuple(far - distance for distance in distances)
        mine = Target(kind=kind, x=x, y=far, depth=self.asked.depth)
        surface = {"phase_screen": False}
        lane = bare_lane(self.ground, self.sensor, 1, far + 10.0, positions, surface, (mine,))
        run = lane.run(bodies=True)

        narrowest = min(float(np.nanmin(self.design.down)), float(np.nanmin(self.design.cross)))
        step = max(narrowest / 3, 0.01)
        peaks = np.empty((len(distances), len(self.sensor.polarization)))
        for scan, distance in enumerate(distances):
            # A buried mine appears behind its position: the wave is slower in the ground.
            grid = Grid.spanning((x - 0.5, x + 0.5), (distance - 0.5, distance + 0.8), step)
            image = self.imager(run.isel(scan=[scan]), grid).image(0)
            peaks[scan] = (np.abs(image.values[:, 0]) ** 2).max(axis=(1, 2))
        return peaks


def _simulate_ratio(design: Design, ground: GroundModel, asked: Question, track: Track) -> None:
    """Simulate single mines and bare ground, image both, and divide peak by mean power."""
    name = design.sensor.name
    copolar = tuple(one for one in design.sensor.polarization if one[0] == one[1])
    if not copolar:
        return
    design.ratio_y = np.linspace(design.y[0] + 0.5, design.y[-1] - 1.0, 7)
    design.ratio_x = np.linspace(design.x[0], design.x[-1], 5)
    sensor = design.sensor.model_copy(update={"polarization": copolar})
    simulation = _Simulation(design, sensor, ground, asked)

    clutter = simulation.clutter()
    shape = (design.ratio_y.size, design.ratio_x.size)
    steps = [(kind, column) for kind in KINDS for column in range(design.ratio_x.size)]
    for kind, column in track(steps, f"{name}: signal to clutter", len(steps)):
        peaks = simulation.peaks(kind, float(design.ratio_x[column]))
        for p, label in enumerate(copolar):
            ratio = design.ratio.setdefault((kind, label), np.empty(shape))
            ratio[:, column] = 10 * np.log10(peaks[:, p] / clutter[p, :, column])
