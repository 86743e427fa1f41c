"""What results of gprMax hold, in words."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np

from flgpr.formats.reader import Explanation, Reader
from flgpr.model import SPEED_OF_LIGHT
from flgpr.model.printable import printable
from flgpr.types import FloatArray
from flgpr_exchange.gprmax.deck_results import MANIFEST, deck_texts
from flgpr_exchange.gprmax.output import (
    attribute_text,
    faults_of_result,
    merged_fields,
    read_gprmax,
    refuse_parts_elsewhere,
)

_MOST_RECEIVERS = 8  # that are described in words
_CELLS_PER_WAVELENGTH = 10  # below which gprMax disperses


def explain_merged(path: Path) -> tuple[list[str], str]:
    """Return in lines what a merged B-scan holds, and a draft of the mapping that imports it.

    Parameters
    ----------
    path : Path
        A result of gprMax.

    Returns
    -------
    lines : list of str
        What it holds; none if it is no merged B-scan.
    mapping : str
        The draft, TOML.

    Raises
    ------
    ValueError
        If the file is damaged.
    """
    with faults_of_result(path), h5py.File(path, "r") as file:
        refuse_parts_elsewhere(file)
        fields = merged_fields(file)
        if not fields:
            return [], ""
        version, title = (attribute_text(file, name) for name in ("gprMax", "Title"))
        interval = float(np.asarray(file.attrs.get("dt", np.nan)))
    if not 0 < interval < np.inf:
        raise ValueError(f"{path}: dt must be greater than 0, got {interval:g} s")
    # The field of a source along the same axis is the strongest, mostly Ez.
    chosen = next((name for name in fields if name.endswith("/Ez")), next(iter(fields)))
    steps, traces = fields[chosen]
    lines = [
        f"result of gprMax {version}: {title or 'no title'}",
        f"merged B-scan of {traces} traces x {steps} steps of {1e9 * interval:.4g} ns",
        *(f"{name}: {shape[0]} x {shape[1]}" for name, shape in fields.items()),
        "a merged file tells neither cells nor places: "
        "where the scans were is for the mapping to say",
    ]
    draft = deck_texts()["mapping"].format(
        file=printable(path.name),
        title=json.dumps(title or path.stem),
        data=json.dumps(path.name),
        variable=json.dumps(chosen),
        steps=steps,
        traces=traces,
        last=f"{interval * (steps - 1):.9g}",
    )
    return lines, draft


def explain_gprmax(path: Path) -> list[str]:
    """Return what a result file holds, a line per fact.

    Parameters
    ----------
    path : Path
        A result of gprMax.

    Returns
    -------
    list of str
        The lines.

    Raises
    ------
    ValueError
        If the file is damaged.
    """
    output = read_gprmax(path)
    nanoseconds = 1e9 * output.steps * output.time_step
    highest = SPEED_OF_LIGHT / (_CELLS_PER_WAVELENGTH * output.cell.max())
    edges = " x ".join(f"{1000 * edge:g}" for edge in output.cell)
    lines = [
        f"result of gprMax {output.version}: {output.title or 'no title'}",
        f"{output.steps} time steps of {1e12 * output.time_step:.4g} ps, {nanoseconds:.4g} ns",
        f"cells of {edges} mm, ten per wavelength in air up to {highest / 1e9:.3g} GHz",
    ]
    for kind, position in output.sources:
        lines.append(f"source {kind or 'of unknown type'} at {_coordinates(position)}")
    receivers = list(output.receivers.values())
    for receiver in receivers[:_MOST_RECEIVERS]:
        bad = sum(np.count_nonzero(~np.isfinite(one)) for one in receiver.fields.values())
        place = _coordinates(receiver.position)
        line = f"receiver {receiver.name} at {place}: {', '.join(receiver.fields)}"
        lines.append(line + (f", {bad} values not finite" if bad else ""))
    if len(receivers) > _MOST_RECEIVERS:
        lines.append(f"and {len(receivers) - _MOST_RECEIVERS} more receivers")
    manifest = path.with_name(MANIFEST)
    if manifest.is_file():
        lines.append(
            f"{manifest.name} beside it: the folder is read by flgpr import gprmax {path.parent}"
        )
    else:
        lines.append(
            "flgpr import gprmax reads it when told band, transmit and ground, one file per scan"
        )
    return lines


def _coordinates(position: FloatArray) -> str:
    """Return a position in words."""
    return "(" + ", ".join(f"{coordinate:.3f}" for coordinate in position) + ") m"


class GprmaxReader(Reader):
    """Results of gprMax, a layout of HDF5."""

    kind = "result of gprMax"
    within = "HDF5 file"

    def owns(self, path: Path, head: bytes) -> bool:  # noqa: ARG002
        """Return whether a sound HDF5 file says that it is of gprMax."""
        with faults_of_result(path), h5py.File(path, "r") as file:
            return "gprMax" in file.attrs

    def explain(self, path: Path, limit: int) -> Explanation:  # noqa: ARG002
        """Return what the model recorded, and of a merged B-scan the draft of a mapping."""
        lines, mapping = explain_merged(path)
        return Explanation(path, self.kind, lines or explain_gprmax(path), mapping, bool(mapping))


READER = GprmaxReader()
