"""Ways to compute the imaging sums behind one interface: term by term, or from interpolated range profiles."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numba import get_num_threads
from numpy.typing import NDArray
from scipy import fft
from scipy.sparse import csr_array

from flgpr.imaging.plan import Layout, Plan, make_plan
from flgpr.kernels import profiles, transform
from flgpr.kernels.direct import adjoint_direct, adjoint_precise, forward_direct, forward_precise
from flgpr.kernels.geometry import antenna_paths
from flgpr.kernels.layout import BLOCK, CHANNELS, KEPT_BYTES, SPREAD_PAIRS, aligned, row_size
from flgpr.kernels.profiles import Geometry, polynomial_degree
from flgpr.kernels.threads import share
from flgpr.model import SPEED_OF_LIGHT
from flgpr.model.arrays import FloatArray

FEW = (
    1 << 15
    # : sums or transform slots of all pairs and channels, a tenth of a millisecond: no other thread
    # is woken
)


class Engine:
    """The adjoint and the forward sums on checked arrays, in the memory of the host unless an engine says otherwise."""

    method = "profile"
    width: int

    def adjoint(self, data: NDArray[Any], out: NDArray[Any]) -> None:
        """Fill ``out`` (polarization, subband, the first pixels or all) from ``data`` (polarization, pair, tone)."""
        raise NotImplementedError

    def forward(self, image: NDArray[Any], out: NDArray[Any]) -> None:
        """Fill ``out`` (polarization, pair, tone) from ``image`` (polarization, subband, pixel)."""
        raise NotImplementedError

    def buffer(self, shape: tuple[int, ...], dtype: np.dtype[Any]) -> NDArray[Any]:
        """Make memory for images."""
        return np.empty(shape, dtype)

    def device_seconds(self, rows: int, subbands: int, repeats: int = 10) -> tuple[float, float]:
        """Refuse: sums on the CPU have no transfers to leave out."""
        raise ValueError(
            f"device must be 'cuda' to time {rows} rows of {subbands} sub-bands {repeats} times, got 'cpu'"
        )


class DirectEngine(Engine):
    """Sums term by term in double precision."""

    method = "direct"
    width = 0

    def __init__(
        self, layout: Layout, frequency: FloatArray, weight: FloatArray, offset: FloatArray
    ) -> None:
        path = np.empty((layout.antenna.shape[0], layout.pixels.shape[1]))
        antenna_paths(layout.pixels, layout.antenna, layout.medium, path)
        active = weight.any(axis=0)
        self._active = active
        self._sums = (
            weight[:, active],
            frequency[active] / SPEED_OF_LIGHT,
            path,
            layout.tx,
            layout.rx,
            offset,
        )
        self._gain = layout.gain

    def adjoint(self, data: NDArray[Any], out: NDArray[Any]) -> None:
        """Fill ``out`` (polarization, subband, pixel) from ``data`` (polarization, pair, tone)."""
        adjoint_direct(np.ascontiguousarray(data[..., self._active]), *self._sums, self._gain, out)

    def forward(self, image: NDArray[Any], out: NDArray[Any]) -> None:
        """Fill ``out`` (polarization, pair, tone) from ``image`` (polarization, subband, pixel)."""
        part = np.empty((*out.shape[:2], np.count_nonzero(self._active)), out.dtype)
        forward_direct(image, *self._sums, self._gain, part)
        out[...] = 0
        out[..., self._active] = part


class ProfileEngine(Engine):
    """Range profiles and their interpolation in single precision on the CPU."""

    def __init__(self, plan: Plan, weight: FloatArray) -> None:
        self.width = plan.window.width
        self._bins = plan.bins
        self._geometry = plan.geometry()
        self._spectrum = plan.spectrum.single()
        self._weight = weight.astype(np.float32)
        self._phase = None if plan.phase is None else plan.phase.astype(np.complex64)
        self._taps, self._powers = (0,) * self.width, (0,) * (polynomial_degree(self.width) + 1)
        self._calls = 0

    def adjoint(self, data: NDArray[Any], out: NDArray[Any]) -> None:
        """Fill ``out`` (polarization, subband, pixel) from ``data`` (polarization, pair, tone)."""
        if self._phase is not None:
            data = data * self._phase
        pairs = data.shape[1]
        blocks = -(-out.shape[2] // BLOCK)
        size = self._spectrum.size
        geometry = self._located()._replace(pixel_count=out.shape[2])
        for rows, bands, channels in passes(*out.shape[:2]):
            table = self._table(channels)
            form = self._form(channels)
            tones = (data[rows], self._weight[bands], self._spectrum, table, *form)
            share(
                pairs,
                partial(transform.compress, *tones),
                form.together,
                pairs * channels * size < FEW,
            )
            part = out[rows, bands].reshape(-1, out.shape[2])
            shape = (self._taps, self._powers, (0,) * channels)
            few = pairs * channels * out.shape[2] < FEW
            share(
                blocks,
                partial(profiles.adjoint, table, self._bins, geometry, part, *shape),
                alone=few,
            )

    def forward(self, image: NDArray[Any], out: NDArray[Any]) -> None:
        """Fill ``out`` (polarization, pair, tone) from ``image`` (polarization, subband, pixel)."""
        out[...] = 0
        # Pairs that share antennas are cheaper together; every thread is to have two tasks at
        # least.
        pairs = out.shape[1]
        geometry = self._located()
        size = self._spectrum.size
        together = min(SPREAD_PAIRS, -(-pairs // (2 * get_num_threads())))
        for rows, bands, channels in passes(*image.shape[:2]):
            table = self._table(channels)
            form = self._form(channels)
            part = image[rows, bands].reshape(-1, image.shape[2])
            shape = (self._taps, self._powers, (0,) * channels)
            few = pairs * channels * image.shape[2] < FEW
            share(
                pairs,
                partial(profiles.forward, table, self._bins, geometry, part, *shape),
                together,
                few,
            )
            tones = (table, self._weight[bands], self._spectrum, out[rows], *form)
            share(
                pairs,
                partial(transform.expand, *tones),
                form.together,
                pairs * channels * size < FEW,
            )
        if self._phase is not None:
            out *= self._phase.conj()

    def _table(self, channels: int) -> NDArray[np.float32]:
        return aligned(
            self._geometry.tx.size * self._bins * row_size(self.width, channels), np.float32
        )

    def _form(self, channels: int) -> transform.Form:
        lane = max(channels, 4)
        return transform.Form(
            row_size(self.width, channels), self.width, lane // channels, (0,) * lane
        )

    def _located(self) -> Geometry:
        """Return the geometry, from the third use on with all delays and phasors unless they are too large to keep.

        To make and write them costs what three images save by reading them.
        """
        geometry = self._geometry
        self._calls += 1
        size = geometry.antenna.shape[0] * geometry.pixels.shape[1]
        if self._calls > 2 and not geometry.delay.size and 12 * size <= KEPT_BYTES:
            delay, cosine, sine = (
                aligned(size, kind) for kind in (np.uint32, np.float32, np.float32)
            )
            geometry = geometry._replace(delay=delay, cosine=cosine, sine=sine)
            share(geometry.pixels.shape[1] // BLOCK, partial(profiles.locate, geometry))
            self._geometry = geometry
        return geometry


class PreciseEngine(Engine):
    """Range profiles and their interpolation in double precision: for tolerances that single precision cannot keep."""

    def __init__(self, plan: Plan, weight: FloatArray) -> None:
        spectrum = plan.spectrum
        self.width = plan.window.width
        self._spectrum = spectrum
        self._weight = weight
        self._phase = plan.phase
        self._geometry = plan.precise_geometry()
        shape = (weight.shape[1], spectrum.size)
        self._slots = csr_array((spectrum.share, spectrum.slot, spectrum.entries), shape=shape)
        self._bin = (spectrum.first + np.arange(plan.bins)) % spectrum.size

    def adjoint(self, data: NDArray[Any], out: NDArray[Any]) -> None:
        """Fill ``out`` (polarization, subband, pixel) from ``data`` (polarization, pair, tone)."""
        for rows, image in zip(data, out, strict=True):
            rows = rows if self._phase is None else rows * self._phase
            tones = rows[:, None, :] * self._weight
            slots = (tones.reshape(-1, tones.shape[2]) @ self._slots).reshape(*tones.shape[:2], -1)
            profile = (
                fft.ifft(slots, axis=2, norm="forward")[..., self._bin] * self._spectrum.factor
            )
            table = np.ascontiguousarray(profile.transpose(0, 2, 1))
            adjoint_precise(table, self._geometry, image)

    def forward(self, image: NDArray[Any], out: NDArray[Any]) -> None:
        """Fill ``out`` (polarization, pair, tone) from ``image`` (polarization, subband, pixel)."""
        pairs = out.shape[1]
        bands = self._weight.shape[0]
        bins = self._bin.size
        table = np.empty((pairs, bins, bands), np.complex128)
        for scene, rows in zip(image, out, strict=True):
            forward_precise(scene, self._geometry, table)
            slots = np.zeros((self._spectrum.size, pairs, bands), np.complex128)
            np.add.at(slots, self._bin, (table * self._spectrum.factor[:, None]).transpose(1, 0, 2))
            slots = fft.fft(slots, axis=0)
            tones = (self._slots @ slots.reshape(slots.shape[0], -1)).reshape(-1, pairs, bands)
            rows[...] = np.einsum("kqs,sk->qk", tones, self._weight)
            if self._phase is not None:
                rows *= self._phase.conj()


def passes(polarizations: int, subbands: int) -> list[tuple[slice, slice, int]]:
    """Split the images into passes of at most as many channels as a lane row holds.

    Returns the polarizations and the sub-bands of each pass and the channels of its rows. A pass takes all sub-bands of
    some polarizations, or some sub-bands of one, so that its images are neighbours in memory.
    """
    most = max(CHANNELS)
    bands_held = min(subbands, most)
    rows_held = most // bands_held if subbands <= most else 1
    found = []
    for row in range(0, polarizations, rows_held):
        rows = slice(row, min(row + rows_held, polarizations))
        for band in range(0, subbands, bands_held):
            bands = slice(band, min(band + bands_held, subbands))
            needed = (rows.stop - rows.start) * (bands.stop - bands.start)
            found.append((rows, bands, min(c for c in CHANNELS if c >= needed)))
    return found


def make_engine(
    layout: Layout, frequency: FloatArray, weight: FloatArray, offset: FloatArray, tolerance: float,
    dtype: np.dtype[Any], device: str, method: str,
) -> Engine:  # fmt: skip
    """Choose and prepare the engine for a device, a precision and a method; a ValueError names what it cannot be."""
    if device not in ("cpu", "cuda"):
        raise ValueError(f"device must be 'cpu' or 'cuda', got {device!r}")
    if method not in ("auto", "profile", "direct"):
        raise ValueError(f"method must be 'auto', 'profile' or 'direct', got {method!r}")
    active = np.asarray(weight.any(axis=0))
    # What single precision adds to the window's error is small but not nothing.
    share = 0.9 * tolerance if dtype == np.dtype(np.complex64) else tolerance
    if device == "cuda":
        return _cuda_engine(
            make_plan(frequency, active, layout, offset, share), weight, tolerance, dtype, method
        )
    # Below this many terms per pair, profiles cost more than the sums themselves.
    if method == "direct" or (method == "auto" and layout.count * np.count_nonzero(active) < 2000):
        return DirectEngine(layout, frequency, weight, offset)
    plan = make_plan(frequency, active, layout, offset, share)
    if dtype == np.dtype(np.complex64) and _fits_single(plan, tolerance):
        return ProfileEngine(plan, weight)
    return PreciseEngine(plan, weight)


def _fits_single(plan: Plan, tolerance: float) -> bool:
    """Whether 32-bit delays are fine enough and 32-bit indices large enough: not with many thousands of tones."""
    return (
        plan.rounding < tolerance / 2
        and plan.layout.tx.size * plan.bins * 2 * max(CHANNELS) < 2**32
    )


def _cuda_engine(
    plan: Plan, weight: FloatArray, tolerance: float, dtype: np.dtype[Any], method: str
) -> Engine:
    if dtype != np.dtype(np.complex64):
        raise ValueError(
            f"dtype must be complex64 (and tolerance at least 1e-5) with device 'cuda', got {dtype}"
        )
    if method == "direct":
        raise ValueError("method must be 'auto' or 'profile' with device 'cuda', got 'direct'")
    if not _fits_single(plan, tolerance):
        raise ValueError(
            f"tolerance must be at least {2 * plan.rounding:.0e} with device 'cuda' and these tones, got {tolerance:g}"
        )
    # Imported here because it needs numba-cuda, which only users of a device install.
    try:
        from flgpr.imaging.cuda import CudaEngine
    except ImportError as error:
        raise ValueError(f"device 'cuda' needs the package numba-cuda: {error}") from None
    return CudaEngine(plan, weight)
