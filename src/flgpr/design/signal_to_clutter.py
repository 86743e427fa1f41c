"""Signal to clutter of a buried body.

By formula, as a budget of factors, and measured on simulated images. Both take the echo of a level
body on its own over the mean echo of the bare rough ground around it. What else lies in, stands on
or grows on the ground, and the errors of the radar, are left out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import stdtrit

from flgpr.design.grounds import GroundModel, bare_lane
from flgpr.design.point_spread import PointSpread
from flgpr.imaging import ImagingOperator
from flgpr.kernels.windows import WINDOWS, band_weights
from flgpr.model import Grid, Sensor
from flgpr.model.refraction import apparent_shift
from flgpr.progress import Track as Progress
from flgpr.progress import silent
from flgpr.simulate.bodies.echoes import LayeredGround, incidence
from flgpr.simulate.bodies.signature import FREQUENCY, find_table
from flgpr.simulate.bodies.targets import mean_amplitude
from flgpr.simulate.ground.roughness import surface_backscatter
from flgpr.simulate.radar.spread import ArrayState
from flgpr.simulate.scene.scene import Target
from flgpr.simulate.simulator import array_state, system_response
from flgpr.types import Complex128Array, ComplexArray, FloatArray

Subbands = Mapping[str, tuple[float, float]]

DEPTHS = (0.0, 0.05, 0.075, 0.10, 0.15)
"""Depths of a body's top that a table of signal to clutter has by default, m."""
_COPOLAR = ("HH", "VV")
_DEEPEST = 1.0  # m
_DELAYS = 16  # delays per tone at which the range profile of a body is computed
# m around the body, and behind where its bottom appears, in which its peak is searched
_AROUND = 0.5
_CLUTTER_ALONG = 1.0  # m before and behind the body from which clutter is taken
_CLUTTER_ACROSS = 1.5  # m to each side
_CLUTTER_STEP = 0.05  # pixel of the clutter's image, m
_LOOKS_APART = 60.0  # m
_PEAK_STEPS = 8.0  # pixels of the body's image per expected width of the point spread
_CONFIDENCE = 0.95


@dataclass(frozen=True)
class Viewing:
    """Distance, height, bands, polarizations and window in which a body is seen."""

    distance: float = 12.0  #: from the array to the body along the ground, m
    height: float | None = None  #: of the array over the ground, m; None takes the sensor's
    #: names and edges (lo, hi) of the sub-bands, Hz; None takes all tones, as ``all``
    subbands: Subbands | None = None
    #: of HH and VV; None takes those of the two that the sensor has. A level round body has no HV
    polarizations: Sequence[str] | None = None
    #: over the tones of a sub-band, as of :class:`flgpr.imaging.ImagingOperator`
    window: str = "boxcar"
    heading: float = 0.0  #: direction of a box's long side, clockwise from ahead, rad


@dataclass(frozen=True)
class _View:
    """A sensor before a body's position on level ground, and the bands and channels of the view."""

    sensor: Sensor  # with the height and the polarizations of the view
    ground: GroundModel
    viewing: Viewing
    subbands: dict[str, tuple[float, float]]

    @property
    def position(self) -> FloatArray:
        """Place of the body on the ground (3,), m."""
        x_min, x_max, _, _ = self.sensor.ground_in_view
        return np.array([(x_min + x_max) / 2, float(self.viewing.distance), 0.0])

    @property
    def sine(self) -> float:
        """Sine of the angle of incidence at the position."""
        x, y, z = self.position
        return incidence(x, y, z, self.array)

    @property
    def array(self) -> ArrayState:
        """Antennas over the origin of the lane frame."""
        return array_state(self.sensor, np.array([0.0, 0.0, self.sensor.height, 0.0, 0.0, 0.0]))

    @property
    def step(self) -> float:
        """Pixel of a body's image, m."""
        widths: list[float] = []
        for edges in self.subbands.values():
            widths.extend(PointSpread(self.sensor, edges).expected_widths(self.position))
        return float(np.clip(min(widths) / _PEAK_STEPS, 0.005, 0.05))

    def target(self, body: str, depth: float) -> Target:
        """Return a body at the position."""
        x, y, _ = self.position
        return Target(kind=body, body=body, x=x, y=y, depth=depth, heading=self.viewing.heading)

    def key(self, body: str, depth: float, subband: str, polarization: str) -> dict[str, Any]:
        """Return the columns that name a case."""
        return {
            "sensor": self.sensor.name,
            "height": self.sensor.height,
            "distance": float(self.viewing.distance),
            "ground": self.ground.name,
            "rms_height": self.ground.surface.rms_height,
            "body": body,
            "depth": float(depth),
            "subband": subband,
            "polarization": polarization,
        }

    def clutter_power(self, seed: int, looks: int, imager: ImagingOperator) -> FloatArray:
        """Return the mean power (polarization, subband) of bare ground around the position."""
        positions = tuple(_LOOKS_APART * look for look in range(looks))
        length = positions[-1] + self.viewing.distance + 10.0
        surface = {"echo": True}
        simulator = bare_lane(self.ground, self.sensor, seed, length, positions, surface)
        powers = [_power(imager, scan).mean(axis=(2, 3)) for scan in simulator.scans()]
        return np.mean(powers, axis=0)

    def peak_power(self, target: Target, seed: int, imager: ImagingOperator) -> FloatArray:
        """Return the peak power (polarization, subband) of a body under a rough surface.

        The surface itself does not echo.
        """
        length = self.viewing.distance + 10.0
        surface = {"echo": False}
        simulator = bare_lane(self.ground, self.sensor, seed, length, (0.0,), surface, (target,))
        return _power(imager, simulator.scan(0)).max(axis=(2, 3))

    def shift(self, target: Target) -> float:
        """Return by how much the bottom of a body appears farther away than it is, m."""
        middles = [np.mean(edges) for edges in self.subbands.values()]
        middle = np.array([np.mean(middles)])
        permittivity = float(self.ground.soil.media(middle)[-1][0].real)
        return float(apparent_shift(target.depth + target.height, permittivity, self.sine))

    def imager(self, across: float, before: float, behind: float, step: float) -> ImagingOperator:
        """Return the operator that images the ground around the position."""
        x, y, _ = self.position.tolist()
        x_edges = (x - across, x + across)
        y_edges = (y - before, y + behind)
        array = self.array
        return ImagingOperator(
            self.sensor.tones.axis(),
            array.position[array.tx],
            array.position[array.rx],
            Grid.spanning(x_edges, y_edges, step).points(),
            list(self.subbands.values()),
            window=self.viewing.window,
        )


def expected_signal_to_clutter(
    sensor: Sensor,
    ground: GroundModel,
    bodies: Sequence[str],
    depths: Sequence[float] = DEPTHS,
    viewing: Viewing | None = None,
) -> pd.DataFrame:
    """Return the expected signal to clutter of level bodies by formula, and its factors.

    ``signal_to_clutter_db`` is ``body + transmission + divergence + attenuation - sigma0 - cell``
    in dB:

    - ``body_dbsm``: ``4π|max_τ Σ_f w(f)·F(f)·exp(j2πfτ)|²/(Σ_f w)²``, the amplitude F of the
      signature table, mean over
      the array's pairs, as the band images it; w is the window times what the radar and its
      antennas do at a tone;
    - ``transmission_db``, ``divergence_db``: ``|t12·t21|²`` and the spreading of the rays as they
      leave the ground;
    - ``attenuation_db``: loss of the soil over the body, there and back. These three are those of
      the imaged peak;
    - ``sigma0_db``: backscatter of the rough surface by small perturbation with a two-scale tilt
      and unevenness
      (:func:`flgpr.simulate.ground.roughness.surface_backscatter`), mean over the band by w²;
    - ``cell_m2``: area of the resolution cell, the integral of the squared point spread over the
      ground.

    What varies over a resolution cell (incidence, distance, antenna pattern), and the phase that
    the rough surface gives to the waves that pass it, are left out.

    Parameters
    ----------
    sensor : Sensor
        The array, which stands level.
    ground : GroundModel
        Soil and surface, as :func:`ground_model` makes them.
    bodies : sequence of str
        Packaged bodies ("tm-62m"; ``flgpr simulate signature`` lists them), or files of signature
        tables.
    depths : sequence of float
        Soil over the top of each, m, from 0 (flush) to 1.
    viewing : Viewing, optional
        Distance, height, sub-bands, polarizations, window and heading.

    Returns
    -------
    pandas.DataFrame
        A row for each body, depth, sub-band and polarization, in this order, with ``sensor``,
        ``height``, ``distance``, ``ground``, ``rms_height`` and the columns above.

    Raises
    ------
    ValueError
        If a parameter breaks its rule: names it, the rule and the value. Sub-bands whose middle is
        beyond the signature tables, at 3.225 GHz, are one of the cases.
    """
    view = _view(sensor, ground, viewing or Viewing())
    check_bodies(bodies, depths)
    rows = []
    for subband, edges in view.subbands.items():
        band = _Band(view, edges)
        sigma0 = band.sigma0()
        cell = band.cell_area()
        for body in bodies:
            for depth in depths:
                factors = band.signal(view.target(body, depth))
                for polarization in view.sensor.polarization:
                    p = _COPOLAR.index(polarization)
                    row = view.key(body, depth, subband, polarization)
                    signal = {name: float(values[p]) for name, values in factors.items()}
                    backscatter = float(sigma0[p])
                    ratio = sum(signal.values()) - backscatter - 10 * math.log10(cell)
                    row |= signal
                    row["sigma0_db"] = backscatter
                    row["cell_m2"] = cell
                    row["signal_to_clutter_db"] = ratio
                    rows.append(row)
    return _in_order(pd.DataFrame(rows), bodies, depths)


def measure_signal_to_clutter(
    sensor: Sensor,
    ground: GroundModel,
    bodies: Sequence[str],
    depths: Sequence[float] = DEPTHS,
    viewing: Viewing | None = None,
    *,
    seeds: int = 6,
    looks: int = 4,
    track: Progress = silent,
) -> pd.DataFrame:
    """Measure the signal to clutter of level bodies on simulated images of random grounds.

    The signal is the peak power around the body, which alone echoes but is seen through the rough
    surface of each seed; the clutter is the mean power of the bare ground there.

    Parameters
    ----------
    sensor, ground, bodies, depths, viewing
        As of :func:`expected_signal_to_clutter`.
    seeds : int
        Number of grounds, at least two.
    looks : int
        Bare stretches of each ground, 60 m apart, that its clutter is the mean of.
    track : callable
        Shows the progress.

    Returns
    -------
    pandas.DataFrame
        Rows as of :func:`expected_signal_to_clutter`; ``signal_to_clutter_db`` is the ratio of the
        means over the seeds, ``low_db`` and ``high_db`` are the ends of its interval of 95 %, from
        the spread between the seeds by Student's distribution.

    Raises
    ------
    ValueError
        If a parameter breaks its rule: names it, the rule and the value.
    """
    view = _view(sensor, ground, viewing or Viewing())
    check_bodies(bodies, depths)
    if seeds < 2:
        raise ValueError(f"seeds must be at least 2, to give an interval, got {seeds}")
    if looks < 1:
        raise ValueError(f"looks must be at least 1, got {looks}")
    wide = view.imager(_CLUTTER_ACROSS, _CLUTTER_ALONG, _CLUTTER_ALONG, _CLUTTER_STEP)
    powers = []
    for seed in track(range(seeds), "bare ground", seeds):
        powers.append(view.clutter_power(seed, looks, wide))
    clutter = np.stack(powers)
    cases = [(body, depth) for body in bodies for depth in depths]
    rows = []
    for body, depth in track(cases, "bodies", len(cases)):
        target = view.target(body, depth)
        close = view.imager(_AROUND, _AROUND, _AROUND + view.shift(target), view.step)
        signal = np.stack([view.peak_power(target, seed, close) for seed in range(seeds)])
        ratio = 10 * np.log10(signal.mean(axis=0) / clutter.mean(axis=0))
        margin = _margin_db(signal, clutter)
        for s, subband in enumerate(view.subbands):
            for p, polarization in enumerate(view.sensor.polarization):
                row = view.key(body, depth, subband, polarization)
                row["signal_to_clutter_db"] = ratio[p, s]
                row["low_db"] = ratio[p, s] - margin[p, s]
                row["high_db"] = ratio[p, s] + margin[p, s]
                row["seeds"] = seeds
                rows.append(row)
    return _in_order(pd.DataFrame(rows), bodies, depths)


class _Band:
    """One sub-band of a view.

    The tones, their weights in the image, and the factors that depend on them.
    """

    def __init__(self, view: _View, edges: tuple[float, float]) -> None:
        self._view = view
        self._edges = edges
        tones = view.sensor.tones.axis()
        weights = band_weights(tones, (edges,), WINDOWS[view.viewing.window])[0]
        used = weights != 0
        self._tones = tones[used]
        self._response = self._radar_response(tones)
        self._weights = (weights * self._response)[used]
        self._sine = view.sine

    def _radar_response(self, tones: FloatArray) -> FloatArray:
        """Return the amplitude of a level echo at the position, by radar and beams (frequency,)."""
        response = np.abs(system_response(self._view.sensor, tones))
        beams = []
        for tone in tones:
            beams.append(self._beams(self._view.position[None], tone)[:, 0].mean())
        return response * np.stack(beams)

    def _beams(self, points: FloatArray, frequency: float) -> FloatArray:
        """Return the amplitude (pair, point) with which pairs see points (point, 3) at a tone, Hz.

        It falls with both distances.
        """
        array = self._view.array
        ray = points - array.position[:, None]
        distance = np.linalg.norm(ray, axis=-1)
        amplitude = 1 / distance
        if not array.dipoles:
            cosine = np.maximum(ray @ array.boresight / distance, 0.0)
            exponent = float(array.exponents(np.array([frequency]))[0])
            amplitude = amplitude * cosine ** (0.5 * exponent)
        return amplitude[array.tx] * amplitude[array.rx]

    def sigma0(self) -> FloatArray:
        """Return the backscatter of the surface, HH and VV (2,), dB.

        It is the mean over the band by the squared weights.
        """
        surface = self._view.ground.surface
        shape = (
            surface.rms_height,
            surface.correlation_length,
            surface.slope,
            surface.unevenness,
            surface.waviness,
        )
        media = self._view.ground.soil.media(self._tones)[0]
        sine = np.full(self._tones.shape, self._sine)
        backscatter = surface_backscatter(self._tones, sine, media, *shape)
        means = [np.average(copolar, weights=self._weights**2) for copolar in backscatter]
        power = np.array(means)
        with np.errstate(divide="ignore"):
            return 10 * np.log10(power) + surface.level_db

    def cell_area(self) -> float:
        """Return the area of the resolution cell at the position, m²."""
        spread = PointSpread(
            self._view.sensor, self._edges, self._view.viewing.window, self._response
        )
        middle = float(np.average(self._tones, weights=self._weights**2))

        def beam(points: FloatArray) -> FloatArray:
            return self._beams(points, middle)

        return spread.cell_area(self._view.position, beam)

    def signal(self, target: Target) -> dict[str, FloatArray]:
        """Return the factors of a body's cross section in the image, HH and VV (2,), dB."""
        ground = LayeredGround(self._view.ground.soil, None, self._tones)
        layer = ground.medium(target.depth)
        amplitude = mean_amplitude(target, ground, self._view.array)
        through = amplitude * ground.entry_squared(self._sine, layer)
        body = self._peak(amplitude)
        entered = self._peak(through)
        attenuated = self._peak(through * ground.dispersion(self._sine, target.depth))
        cosine = math.sqrt(1 - self._sine**2)
        divergence = 20 * math.log10(cosine / math.sqrt(ground.real[layer] - self._sine**2))
        return {
            "body_dbsm": body + 10 * math.log10(4 * math.pi),
            "transmission_db": entered - body - divergence,
            "divergence_db": np.full(2, divergence),
            "attenuation_db": attenuated - entered,
        }

    def _peak(self, amplitude: Complex128Array) -> FloatArray:
        """Return the peak over delay of the range profiles of spectra (2, frequency), dB (2,).

        It is relative to the sum of the weights.
        """
        count = _DELAYS * self._tones.size
        profile = np.fft.ifft(amplitude * self._weights, count, axis=-1) * count
        return 20 * np.log10(np.abs(profile).max(axis=-1) / self._weights.sum())


def _view(sensor: Sensor, ground: GroundModel, viewing: Viewing) -> _View:
    """Return the view of a sensor; refuse what is out of range, and a smooth surface."""
    height = viewing.height
    distance = viewing.distance
    window = viewing.window
    if height is not None:
        if not (math.isfinite(height) and height > 0):
            raise ValueError(f"height must be greater than 0, got {height!r}")
        sensor = sensor.model_copy(update={"height": height})
    if window not in WINDOWS:
        raise ValueError(f"window must be one of {', '.join(WINDOWS)}, got {window!r}")
    _, _, y_min, y_max = sensor.ground_in_view
    if not y_min <= distance <= y_max:
        raise ValueError(
            f"distance must lie in the footprint of {sensor.name}, {y_min:g} to {y_max:g} m, "
            f"got {distance!r}"
        )
    bands = _checked_bands(sensor, viewing.subbands)
    polarizations = _checked_polarizations(sensor, viewing.polarizations)
    sensor = sensor.model_copy(update={"polarization": polarizations})
    if ground.surface.rms_height <= 0 and ground.surface.unevenness <= 0:
        raise ValueError(
            "rms_height or unevenness must be greater than 0, "
            "for a smooth surface has no clutter, got 0"
        )
    return _View(sensor, ground, viewing, bands)


def _checked_bands(sensor: Sensor, subbands: Subbands | None) -> dict[str, tuple[float, float]]:
    """Return the sub-bands; refuse one without tones or beyond the signature tables."""
    tones = sensor.tones.axis()
    bands = {"all": (float(tones[0]), float(tones[-1]))} if subbands is None else dict(subbands)
    if not bands:
        raise ValueError("subbands must name at least one band, got none")
    for name, (low, high) in bands.items():
        inside = tones[(tones >= low) & (tones <= high)]
        if inside.size < 2:
            raise ValueError(
                f"sub-band {name} must hold at least two tones, got {low:g} to {high:g} Hz"
            )
        if inside.mean() > FREQUENCY[-1]:
            raise ValueError(
                f"sub-band {name} must have its middle at or below "
                f"{FREQUENCY[-1] / 1e9:g} GHz, where the signature tables end, "
                f"got {inside.mean() / 1e9:.4g} GHz"
            )
    return bands


def _checked_polarizations(sensor: Sensor, polarizations: Sequence[str] | None) -> tuple[str, ...]:
    """Return the polarizations; refuse any but HH and VV of the sensor."""
    available = [name for name in _COPOLAR if name in sensor.polarization]
    requested = available if polarizations is None else list(polarizations)
    unknown = [name for name in requested if name not in available]
    if unknown or not requested:
        raise ValueError(
            f"polarizations must be among those of HH and VV that {sensor.name} has "
            f"({', '.join(available) or 'none'}), "
            f"got {', '.join(unknown or requested) or 'none'}"
        )
    return tuple(requested)


def check_bodies(bodies: Sequence[str], depths: Sequence[float]) -> None:
    """Refuse unknown bodies and depths out of range."""
    if isinstance(bodies, str) or not len(bodies):
        raise ValueError(f"bodies must be a sequence of at least one name, got {bodies!r}")
    if not len(depths):
        raise ValueError("depths must be at least one, got none")
    for body in bodies:
        find_table(body)
    for depth in depths:
        if not 0 <= depth <= _DEEPEST:
            raise ValueError(f"depth must lie between 0 and {_DEEPEST:g} m, got {depth!r}")


def _in_order(table: pd.DataFrame, bodies: Sequence[str], depths: Sequence[float]) -> pd.DataFrame:
    """Sort rows by body and depth in the order of the arguments, otherwise as they stand."""
    body_index = table["body"].map(list(bodies).index)
    depth_index = table["depth"].map([float(depth) for depth in depths].index)
    rank = body_index * len(depths) + depth_index
    order = np.argsort(rank.to_numpy(), kind="stable")
    return table.iloc[order].reset_index(drop=True)


def _power(imager: ImagingOperator, scan: ComplexArray) -> FloatArray:
    """Return the power of the image of a scan, (polarization, subband, y, x)."""
    return np.abs(imager.adjoint(scan).astype(np.complex128)) ** 2


def _margin_db(signal: FloatArray, clutter: FloatArray) -> FloatArray:
    """Return half the interval of the ratio of two means over seeds (seed, ...), dB."""
    factor = float(stdtrit(len(signal) - 1, (1 + _CONFIDENCE) / 2))
    spread = np.hypot(_relative_error(signal), _relative_error(clutter))
    return 10 / math.log(10) * factor * spread


def _relative_error(power: FloatArray) -> FloatArray:
    """Return the relative standard error of the mean over the first axis."""
    return power.std(axis=0, ddof=1) / power.mean(axis=0) / math.sqrt(len(power))
