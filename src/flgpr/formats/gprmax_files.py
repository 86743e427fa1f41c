"""Results of anybody's gprMax models, one file a scan, as a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from flgpr.formats.gprmax import GprmaxOutput, fourier, read_gprmax
from flgpr.model import make_run

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class GprmaxTold:
    """What a result file of gprMax does not tell: tones to keep, the source's polarization, height of the ground, axes.

    ``waveform`` is type and frequency of the source's; results of gprMax 3 need it, those of gprMax 4 hold samples.
    """

    band: tuple[float, float]
    transmit: str
    ground: float
    horizontal: str = "x"
    vertical: str = "z"
    waveform: tuple[str, float] | None = None


def import_gprmax_files(paths: Sequence[str | Path], told: GprmaxTold) -> xr.Dataset:
    """Read results of gprMax models, one a scan, as a run whose vehicle frame has its origin at the source.

    The model's axes are the lane's, its z less ``ground``. The signal is the field over the source's current moment
    where the source is a Hertzian dipole, else over the source's current, times j, as in
    :class:`flgpr.formats.gprmax.GprmaxRun`; the direct wave stays. Tones are those of the time window. Places are the
    nodes'; field components lie half a cell further along their own axis. What was assumed, left out or is missing is
    in ``import_notes``, with a count.
    """
    if not paths:
        raise ValueError("files must be one or more, got none")
    if told.transmit not in ("H", "V"):
        raise ValueError(f"transmit must be H or V, got {told.transmit!r}")
    axes = {"H": told.horizontal, "V": told.vertical}
    if not set(axes.values()) <= set("xyz") or len(set(axes.values())) != 2:
        raise ValueError(
            f"the components of H and V must be two of x, y and z, got {axes['H']!r} and {axes['V']!r}"
        )
    first: GprmaxOutput | None = None
    form: list[FloatArray] = []
    blocks = []
    pose = np.zeros((len(paths), 6))
    for scan, path in enumerate(paths):
        output = read_gprmax(path)
        place, offsets = _geometry(output)
        if first is None:
            first = output
            form = offsets
            tones = _tones(output, told.band)
            labels = _labels(output, told.transmit, axes)
            notes = _notes(output, told, axes, labels)
        _check_alike(output, first, offsets, form)
        pose[scan, :3] = place - [0.0, 0.0, told.ground]
        blocks.append(_signal(output, labels, axes, tones, _source(output, told, tones)))
    rx = np.array(form)
    attrs: dict[str, Any] = {
        "source": "gprMax",
        "title": first.title if first else "",
        "direct_wave": "kept",
    }
    signal = np.stack(blocks)
    missing = np.count_nonzero(~np.isfinite(signal).all(axis=-1))
    if missing:
        sweeps = signal[..., 0].size
        notes.append(
            f"{missing} of {sweeps} fields hold values that are no numbers, and count as missing"
        )
    attrs["import_notes"] = notes
    return make_run(signal, tones, labels, np.zeros_like(rx), rx, pose, attrs=attrs)


def _notes(
    output: GprmaxOutput, told: GprmaxTold, axes: dict[str, str], labels: list[str]
) -> list[str]:
    """Tell what is assumed of the first file, which those after it are like, and what of its fields is not used."""
    notes = [
        "the direct wave stays in the data",
        f"H is taken as the component {told.horizontal}, V as {told.vertical}",
        f"the ground is put at a height of {told.ground:g} m in the model, as given",
        f"places are those of the nodes: field components lie up to {500 * output.cell.max():g} mm further",
    ]
    if output.excitation is None and told.waveform is not None:
        kind, frequency = told.waveform
        notes.append(
            f"the source's waveform is taken as {kind} of {frequency / 1e9:g} GHz and unit amplitude, as given"
        )
    kind = output.sources[0][0]
    if kind != "HertzianDipole":
        notes.append(
            f"the source is of type {kind or 'unknown'}: the field is taken over its current, not its moment"
        )
    used = {f"E{axes[label[1]]}" for label in labels}
    count = len(output.receivers)
    recorded: dict[str, int] = {}
    for receiver in output.receivers.values():
        for name in receiver.fields:
            recorded[name] = recorded.get(name, 0) + 1
    for name, times in sorted(recorded.items()):
        if name not in used:
            notes.append(f"{name} of {times} of {count} receivers is not used")
    return notes


def _geometry(output: GprmaxOutput) -> tuple[FloatArray, list[FloatArray]]:
    if len(output.sources) != 1:
        raise ValueError(f"{output.path}: must hold one source, got {len(output.sources)}")
    if not output.receivers:
        raise ValueError(f"{output.path}: must hold a receiver, got none")
    place = output.sources[0][1]
    return place, [one.position - place for one in output.receivers.values()]


def _tones(output: GprmaxOutput, band: tuple[float, float]) -> FloatArray:
    step = 1 / (output.steps * output.time_step)
    if not 0 < band[0] < band[1] < 0.5 / output.time_step:
        raise ValueError(
            f"band must increase below {0.5 / output.time_step:.3g} Hz, got {band[0]:g} to {band[1]:g}"
        )
    numbers = np.arange(np.ceil(band[0] / step - 1e-6), np.floor(band[1] / step + 1e-6) + 1)
    if numbers.size < 2:
        raise ValueError(
            f"band must hold two tones, which are {step:.4g} Hz apart, got {band[0]:g} to {band[1]:g}"
        )
    return np.asarray(numbers * step)


def _labels(output: GprmaxOutput, transmit: str, axes: dict[str, str]) -> list[str]:
    """Name the polarizations whose component every receiver recorded."""
    labels = [
        transmit + end
        for end in "HV"
        if all(f"E{axes[end]}" in one.fields for one in output.receivers.values())
    ]
    if not labels:
        raise ValueError(f"{output.path}: every receiver must hold E{axes['H']} or E{axes['V']}")
    return labels


def _check_alike(
    output: GprmaxOutput, first: GprmaxOutput, offsets: list[FloatArray], form: list[FloatArray]
) -> None:
    if output.steps != first.steps or abs(output.time_step / first.time_step - 1) > 1e-9:
        raise ValueError(
            f"{output.path}: must have {first.steps} steps of {first.time_step:g} s as the first file, got "
            f"{output.steps} of {output.time_step:g} s"
        )
    if (
        len(offsets) != len(form)
        or max(np.abs(a - b).max() for a, b in zip(offsets, form, strict=True)) > 1e-6
    ):
        raise ValueError(
            f"{output.path}: receivers must stand about the source as in the first file, they do not"
        )


def _source(output: GprmaxOutput, told: GprmaxTold, tones: FloatArray) -> NDArray[np.complex128]:
    """Spectrum of the source: its current moment where the file tells the length, else its current."""
    if output.excitation is not None:
        one = output.excitation
        return fourier(one.samples, output.time_step, tones, one.start) * one.length
    if told.waveform is None:
        raise ValueError(
            f"{output.path}: the source's waveform is not in the file: type and frequency must be told"
        )
    length = dict(zip("xyz", output.cell, strict=True))[
        told.horizontal if told.transmit == "H" else told.vertical
    ]
    moment = length if output.sources[0][0] == "HertzianDipole" else 1.0
    return output.current(*told.waveform, tones) * moment


def _signal(
    output: GprmaxOutput,
    labels: list[str],
    axes: dict[str, str],
    tones: FloatArray,
    source: NDArray[np.complex128],
) -> NDArray[np.complex64]:
    rows = [
        [
            1j * output.spectrum(name, f"E{axes[label[1]]}", tones) / source
            for name in output.receivers
        ]
        for label in labels
    ]
    return np.asarray(rows, dtype=np.complex64)
