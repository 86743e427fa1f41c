"""Results of anybody's gprMax models, one file a scan, as a run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from flgpr.model import make_run
from flgpr.types import Complex128Array, ComplexArray, Entries, FloatArray
from flgpr_exchange.gprmax.output import GprmaxOutput, fourier_integral, read_gprmax


@dataclass(frozen=True)
class GprmaxSetup:
    """What of a model its result file does not state."""

    band: tuple[float, float]  #: tones to keep, Hz
    transmit: str  #: polarization of the source, "H" or "V"
    ground: float  #: height of the ground in the model, m
    horizontal: str = "x"  #: axis of H
    vertical: str = "z"  #: axis of V
    #: type and frequency of the source's; results of gprMax 3 need it, those of gprMax 4 hold
    #: samples
    waveform: tuple[str, float] | None = None

    @property
    def axes(self) -> dict[str, str]:
        """The model's axis of each polarization."""
        return {"H": self.horizontal, "V": self.vertical}


def import_gprmax_files(paths: Sequence[str | Path], setup: GprmaxSetup) -> xr.Dataset:
    """Read results of gprMax models, one a scan, as a run.

    The vehicle frame has its origin at the source. The model's axes are the lane's, its z less the
    height of the ground. The signal is the field over the source's current moment where the source
    is a Hertzian dipole, else over the source's current, times j, as in
    :class:`flgpr_exchange.gprmax.deck_results.GprmaxRun`; the direct wave stays. Tones are those of the
    time window. Positions are the nodes'; field components lie half a cell further along their own
    axis.

    Parameters
    ----------
    paths : sequence of path
        The files in the order of the scans.
    setup : GprmaxSetup
        What they do not state.

    Returns
    -------
    xarray.Dataset
        The run (:func:`flgpr.model.make_run`); ``import_notes`` state what was assumed, left out
        or is missing, with a count.

    Raises
    ------
    ValueError
        If there is no file, one is damaged or unlike the first, or ``setup`` does not fit them.
    """
    if not paths:
        raise ValueError("files must be one or more, got none")
    if setup.transmit not in ("H", "V"):
        raise ValueError(f"transmit must be H or V, got {setup.transmit!r}")
    axes = setup.axes
    components = set(axes.values())
    if not components <= set("xyz") or len(components) != 2:
        raise ValueError(
            "the components of H and V must be two of x, y and z, "
            f"got {axes['H']!r} and {axes['V']!r}"
        )

    first: GprmaxOutput | None = None
    first_offsets: list[FloatArray] = []
    blocks = []
    pose = np.zeros((len(paths), 6))
    for scan, path in enumerate(paths):
        output = read_gprmax(path)
        position, offsets = _geometry(output)
        if first is None:
            first = output
            first_offsets = offsets
            tones = _tones(output, setup.band)
            labels = _labels(output, setup)
            notes = _notes(output, setup, labels)
        if output.steps != first.steps or abs(output.time_step / first.time_step - 1) > 1e-9:
            raise ValueError(
                f"{output.path}: must have {first.steps} steps of {first.time_step:g} s as the "
                f"first file, got {output.steps} of {output.time_step:g} s"
            )
        are_alike = np.shape(offsets) == np.shape(first_offsets)
        if not are_alike or np.abs(np.subtract(offsets, first_offsets)).max() > 1e-6:
            raise ValueError(
                f"{output.path}: receivers must stand about the source as in the first file, "
                "they do not"
            )
        pose[scan, :3] = position - [0.0, 0.0, setup.ground]
        blocks.append(_signal(output, setup, labels, tones))

    signal = np.stack(blocks)
    missing = np.count_nonzero(~np.isfinite(signal).all(axis=-1))
    if missing:
        fields = signal[..., 0].size
        notes.append(
            f"{missing} of {fields} fields hold values that are no numbers, and count as missing"
        )

    rx = np.array(first_offsets)
    attrs: Entries = {
        "source": "gprMax",
        "title": first.title if first else "",
        "direct_wave": "kept",
        "import_notes": notes,
    }
    return make_run(signal, tones, labels, np.zeros_like(rx), rx, pose, attrs=attrs)


def _notes(output: GprmaxOutput, setup: GprmaxSetup, labels: list[str]) -> list[str]:
    """Return what is assumed of the first file, and what of its fields is not used.

    Those after it are like it.
    """
    half_cell = 500 * output.cell.max()  # mm
    notes = [
        "the direct wave stays in the data",
        f"H is taken as the component {setup.horizontal}, V as {setup.vertical}",
        f"the ground is put at a height of {setup.ground:g} m in the model, as given",
        f"places are those of the nodes: field components lie up to {half_cell:g} mm further",
    ]
    if output.excitation is None and setup.waveform is not None:
        waveform, frequency = setup.waveform
        notes.append(
            f"the source's waveform is taken as {waveform} of {frequency / 1e9:g} GHz and unit "
            "amplitude, as given"
        )
    kind = output.sources[0][0]
    if kind != "HertzianDipole":
        notes.append(
            f"the source is of type {kind or 'unknown'}: the field is taken over its current, "
            "not its moment"
        )
    used = {f"E{setup.axes[label[1]]}" for label in labels}
    recorded = Counter(name for one in output.receivers.values() for name in one.fields)
    for name, times in sorted(recorded.items()):
        if name not in used:
            notes.append(f"{name} of {times} of {len(output.receivers)} receivers is not used")
    return notes


def _geometry(output: GprmaxOutput) -> tuple[FloatArray, list[FloatArray]]:
    """Return the position of the source, and the receivers' offsets from it, m."""
    if len(output.sources) != 1:
        raise ValueError(f"{output.path}: must hold one source, got {len(output.sources)}")
    if not output.receivers:
        raise ValueError(f"{output.path}: must hold a receiver, got none")
    source = output.sources[0][1]
    return source, [receiver.position - source for receiver in output.receivers.values()]


def _tones(output: GprmaxOutput, band: tuple[float, float]) -> FloatArray:
    """Return the tones of the time window in a band, Hz."""
    step = 1 / (output.steps * output.time_step)
    low, high = band
    if not 0 < low < high < 0.5 / output.time_step:
        raise ValueError(
            f"band must increase below {0.5 / output.time_step:.3g} Hz, got {low:g} to {high:g}"
        )
    first = np.ceil(low / step - 1e-6)
    last = np.floor(high / step + 1e-6)
    numbers = np.arange(first, last + 1)
    if numbers.size < 2:
        raise ValueError(
            f"band must hold two tones, which are {step:.4g} Hz apart, got {low:g} to {high:g}"
        )
    return np.asarray(numbers * step)


def _labels(output: GprmaxOutput, setup: GprmaxSetup) -> list[str]:
    """Return the polarizations whose component every receiver recorded."""
    receivers = output.receivers.values()
    labels = [
        setup.transmit + receive
        for receive, axis in setup.axes.items()
        if all(f"E{axis}" in receiver.fields for receiver in receivers)
    ]
    if not labels:
        raise ValueError(
            f"{output.path}: every receiver must hold E{setup.horizontal} or E{setup.vertical}"
        )
    return labels


def _source(output: GprmaxOutput, setup: GprmaxSetup, tones: FloatArray) -> Complex128Array:
    """Return the spectrum (frequency,) of the source.

    It is its current moment where the file states the length, else its current.
    """
    if output.excitation is not None:
        samples, start, length = output.excitation
        return fourier_integral(samples, output.time_step, tones, start) * length
    if setup.waveform is None:
        raise ValueError(
            f"{output.path}: the source's waveform is not in the file: "
            "type and frequency must be told"
        )
    length = 1.0
    if output.sources[0][0] == "HertzianDipole":
        length = output.cell["xyz".index(setup.axes[setup.transmit])]
    return output.current(*setup.waveform, tones) * length


def _signal(
    output: GprmaxOutput, setup: GprmaxSetup, labels: list[str], tones: FloatArray
) -> ComplexArray:
    """Return the signal (polarization, pair, frequency) of one scan."""
    source = _source(output, setup, tones)
    # Times j, a scatterer at path L gives exp(-j2πfL/c) as in every run.
    rows = [
        [
            1j * output.spectrum(name, f"E{setup.axes[label[1]]}", tones) / source
            for name in output.receivers
        ]
        for label in labels
    ]
    return np.asarray(rows, dtype=np.complex64)
