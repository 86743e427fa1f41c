"""
On a GPU
========

The imaging operator runs on an NVIDIA device with ``device="cuda"``; nothing else
changes. This page was built on a machine without one, as the output below may show: the code takes
a device where there is one and the processor where there is none.

**No speed on a GPU has been measured yet.** The kernels are tested under numba's simulator, which shows that they
compute the right thing and nothing about how fast.
"""

import numpy as np

from flgpr.imaging import ImagingOperator
from flgpr.model import Grid, load_sensor


def device_here():
    """Say "cuda" where numba-cuda is installed and finds a device."""
    try:
        from numba import cuda
    except ImportError:
        return "cpu"
    return "cuda" if cuda.is_available() else "cpu"


device = device_here()
print("imaging on:", device)

# %%
# Install the extra first: ``pip install "flgpr[cuda]"``. Single precision only; a tolerance below 1e-5 needs the
# processor.

sensor = load_sensor("dual-band-l")
tx, rx = sensor.pairs()
up = np.array([0.0, 0.0, sensor.height])
grid = Grid.spanning((-3.0, 3.0), (8.0, 14.0), 0.1)
operator = ImagingOperator(
    sensor.tones.axis(),
    tx + up,
    rx + up,
    grid.points(),
    window="hann",
    device=device,
)

# %%
# Scans go through in batches: leading axes of the data are scans taken with one geometry. ``image_buffer`` gives
# memory that a device can write to directly (page-locked there, ordinary here), to be filled again and again.

rng = np.random.default_rng(0)
tones = len(sensor.tones.axis())
shape = (2, len(sensor.polarization), len(tx), tones)
scans = (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(
    np.complex64
)
images = operator.image_buffer(2, len(sensor.polarization))
operator.adjoint(scans, out=images)
print("images:", images.shape, images.dtype)

# %%
# The same sums in double precision on the processor are the reference; the error must stay below the tolerance
# (1e-3 by default) on every device.

few = grid.points()[::12, ::12]
exact = ImagingOperator(
    sensor.tones.axis(), tx + up, rx + up, few, window="hann", method="direct"
)
difference = images[0][..., ::12, ::12] - exact.adjoint(scans[0])
error = np.linalg.norm(difference) / np.linalg.norm(exact.adjoint(scans[0]))
print(f"relative error on {few.shape[0] * few.shape[1]} pixels: {error:.1e}")
assert error < 1e-3

# %%
# To measure your device: ``python benchmarks/imaging_speed --device cuda`` times single scans and batches of 32 from host to host,
# and the sums alone with the data on the device, with ``--peers`` beside cuFINUFFT. ``device`` is an argument of
# :class:`flgpr.imaging.ImagingOperator` and :class:`flgpr.imaging.ScanImager`, and a key of a recipe's table ``[image]``.
