"""The imaging sums on the CPU: term by term, or from interpolated range profiles."""

from __future__ import annotations

from functools import partial

import numpy as np
from numba import get_num_threads
from scipy import fft
from scipy.sparse import csr_array

from flgpr.imaging.backend import Backend
from flgpr.imaging.plan import ImagingLayout, Plan
from flgpr.jit.threads import share
from flgpr.kernels import profiles, transform
from flgpr.kernels.direct import adjoint_direct, forward_direct
from flgpr.kernels.layout import BLOCK, CHANNELS, KEPT_BYTES, SPREAD_PAIRS, aligned, row_size
from flgpr.kernels.precise import adjoint_precise, forward_precise
from flgpr.kernels.profiles import Geometry, polynomial_degree
from flgpr.model import SPEED_OF_LIGHT
from flgpr.types import AnyArray, Float32Array, FloatArray

FEW = 1 << 15
"""Sums, or transform slots, below which no other thread is woken: a tenth of a millisecond."""


class DirectBackend(Backend):
    """Compute the sums term by term in double precision."""

    method = "direct"
    width = 0

    def __init__(
        self, layout: ImagingLayout, frequency: FloatArray, weight: FloatArray, offset: FloatArray
    ) -> None:
        active = weight.any(axis=0)
        self._active = active
        self._sums = (
            weight[:, active],
            frequency[active] / SPEED_OF_LIGHT,
            layout.paths(),
            layout.tx,
            layout.rx,
            offset,
        )
        self._gain = layout.gain

    def adjoint(self, data: AnyArray, out: AnyArray) -> None:
        """Fill ``out`` (polarization, subband, pixel) from ``data`` (polarization, pair, tone)."""
        adjoint_direct(np.ascontiguousarray(data[..., self._active]), *self._sums, self._gain, out)

    def forward(self, image: AnyArray, out: AnyArray) -> None:
        """Fill ``out`` (polarization, pair, tone) from ``image`` (polarization, subband, pixel)."""
        active_tones = np.empty((*out.shape[:2], np.count_nonzero(self._active)), out.dtype)
        forward_direct(image, *self._sums, self._gain, active_tones)
        out[...] = 0
        out[..., self._active] = active_tones


class ProfileBackend(Backend):
    """Interpolate range profiles in single precision on the CPU."""

    def __init__(self, plan: Plan, weight: FloatArray) -> None:
        self.width = plan.window.width
        self._bins = plan.bins
        self._geometry = plan.geometry()
        self._spectrum = plan.spectrum.single()
        self._weight = weight.astype(np.float32)
        self._phase = None if plan.phase is None else plan.phase.astype(np.complex64)
        # Tuples whose lengths the kernels are compiled for.
        self._taps = (0,) * self.width
        self._powers = (0,) * (polynomial_degree(self.width) + 1)
        self._calls = 0

    def adjoint(self, data: AnyArray, out: AnyArray) -> None:
        """Fill ``out`` (polarization, subband, pixel) from ``data`` (polarization, pair, tone)."""
        if self._phase is not None:
            data = data * self._phase
        pairs = data.shape[1]
        pixels = out.shape[2]
        blocks = -(-pixels // BLOCK)
        size = self._spectrum.size
        geometry = self._located()._replace(pixel_count=pixels)
        for rows, bands, channels in channel_groups(*out.shape[:2]):
            # Tones to range profiles, pairs shared between threads.
            table = self._table(channels)
            form = self._form(channels)
            compress = partial(
                transform.compress, data[rows], self._weight[bands], self._spectrum, table, *form
            )
            share(pairs, compress, form.together, alone=pairs * channels * size < FEW)

            # Range profiles to images, blocks of pixels shared between threads.
            images = out[rows, bands].reshape(-1, pixels)
            lengths = (self._taps, self._powers, (0,) * channels)
            interpolate = partial(profiles.adjoint, table, self._bins, geometry, images, *lengths)
            share(blocks, interpolate, alone=pairs * channels * pixels < FEW)

    def forward(self, image: AnyArray, out: AnyArray) -> None:
        """Fill ``out`` (polarization, pair, tone) from ``image`` (polarization, subband, pixel)."""
        out[...] = 0
        # Pairs that share antennas are cheaper together; every thread needs at least two tasks.
        pairs = out.shape[1]
        pixels = image.shape[2]
        geometry = self._located()
        size = self._spectrum.size
        two_tasks_each = -(-pairs // (2 * get_num_threads()))
        together = min(SPREAD_PAIRS, two_tasks_each)
        for rows, bands, channels in channel_groups(*image.shape[:2]):
            # Images to range profiles, and these to tones.
            table = self._table(channels)
            form = self._form(channels)
            images = image[rows, bands].reshape(-1, pixels)
            lengths = (self._taps, self._powers, (0,) * channels)
            spread = partial(profiles.forward, table, self._bins, geometry, images, *lengths)
            share(pairs, spread, together, alone=pairs * channels * pixels < FEW)
            expand = partial(
                transform.expand, table, self._weight[bands], self._spectrum, out[rows], *form
            )
            share(pairs, expand, form.together, alone=pairs * channels * size < FEW)
        if self._phase is not None:
            out *= self._phase.conj()

    def _table(self, channels: int) -> Float32Array:
        """Allocate the range profiles of all pairs."""
        size = self._geometry.tx.size * self._bins * row_size(self.width, channels)
        return aligned(size, np.float32)

    def _form(self, channels: int) -> transform.Form:
        """Return the layout of the rows of a profile."""
        lane = max(channels, 4)
        return transform.Form(
            row_size(self.width, channels), self.width, lane // channels, (0,) * lane
        )

    def _located(self) -> Geometry:
        """Return the geometry, from the third use on with all delays and phasors if they fit.

        To compute and write them costs what three images save by reading them.
        """
        geometry = self._geometry
        self._calls += 1
        size = geometry.antenna.shape[0] * geometry.pixels.shape[1]
        if self._calls > 2 and not geometry.delay.size and 12 * size <= KEPT_BYTES:
            geometry = geometry._replace(
                delay=aligned(size, np.uint32),
                cosine=aligned(size, np.float32),
                sine=aligned(size, np.float32),
            )
            share(geometry.pixels.shape[1] // BLOCK, partial(profiles.locate, geometry))
            self._geometry = geometry
        return geometry


class PreciseBackend(Backend):
    """Interpolate range profiles in double precision, for tolerances beyond single precision."""

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

    def adjoint(self, data: AnyArray, out: AnyArray) -> None:
        """Fill ``out`` (polarization, subband, pixel) from ``data`` (polarization, pair, tone)."""
        for sweeps, image in zip(data, out, strict=True):
            if self._phase is not None:
                sweeps = sweeps * self._phase
            tones = sweeps[:, None, :] * self._weight  # (pair, subband, tone)
            slots = tones.reshape(-1, tones.shape[2]) @ self._slots
            spectra = slots.reshape(*tones.shape[:2], -1)
            profile = fft.ifft(spectra, axis=2, norm="forward")[..., self._bin]
            profile = profile * self._spectrum.factor
            table = np.ascontiguousarray(profile.transpose(0, 2, 1))
            adjoint_precise(table, self._geometry, image)

    def forward(self, image: AnyArray, out: AnyArray) -> None:
        """Fill ``out`` (polarization, pair, tone) from ``image`` (polarization, subband, pixel)."""
        pairs = out.shape[1]
        bands = self._weight.shape[0]
        bins = self._bin.size
        table = np.empty((pairs, bins, bands), np.complex128)
        for scene, rows in zip(image, out, strict=True):
            forward_precise(scene, self._geometry, table)
            profile = (table * self._spectrum.factor[:, None]).transpose(1, 0, 2)
            slots = np.zeros((self._spectrum.size, pairs, bands), np.complex128)
            # A table longer than the transform wraps: bins that fall together are added.
            np.add.at(slots, self._bin, profile)
            spectra = fft.fft(slots, axis=0)
            flat = self._slots @ spectra.reshape(spectra.shape[0], -1)
            tones = flat.reshape(-1, pairs, bands)
            rows[...] = np.einsum("kqs,sk->qk", tones, self._weight)
            if self._phase is not None:
                rows *= self._phase.conj()


def channel_groups(polarizations: int, subbands: int) -> list[tuple[slice, slice, int]]:
    """Split the images into groups of at most as many channels as a lane row holds.

    Each group is one call of the kernels. It takes all sub-bands of some polarizations, or some
    sub-bands of one, so that its images are neighbours in memory.

    Parameters
    ----------
    polarizations, subbands : int
        Numbers of polarizations and sub-bands.

    Returns
    -------
    list of (slice, slice, int)
        Polarizations and sub-bands of each group, and the channels of its rows.
    """
    most = max(CHANNELS)
    bands_at_once = min(subbands, most)
    rows_at_once = most // bands_at_once if subbands <= most else 1
    groups = []
    for row in range(0, polarizations, rows_at_once):
        rows = slice(row, min(row + rows_at_once, polarizations))
        for band in range(0, subbands, bands_at_once):
            bands = slice(band, min(band + bands_at_once, subbands))
            needed = (rows.stop - rows.start) * (bands.stop - bands.start)
            channels = min(count for count in CHANNELS if count >= needed)
            groups.append((rows, bands, channels))
    return groups
