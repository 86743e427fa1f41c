"""What a file holds, in words, and a first draft of the mapping that imports it.

Guesses in a draft end in a question mark.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from flgpr.door import read_named
from flgpr.formats.arrays import LIMIT, ArrayFile, ArrayInfo, open_arrays
from flgpr.formats.draft_single import draft_of_file
from flgpr.formats.draft_units import SMALL
from flgpr.formats.gpr_files import is_gpr
from flgpr.formats.gprmax import is_gprmax
from flgpr.formats.gprmax_explain import explain_gprmax, explain_merged
from flgpr.store.extras import optional
from flgpr.store.files import existing
from flgpr.store.store_layout import MAX_MEMORY

_WITHOUT_MAPPING = (
    "CPHD file",
    "NMEA 0183 log",
    "result of gprMax",
    "take of OptiTrack Motive",
)
"""Kinds of files that are read without a mapping, besides recordings of commercial radars."""


@dataclass(frozen=True)
class Explanation:
    """What a file holds."""

    path: Path
    kind: str
    lines: list[str] = field(default_factory=list)  #: what it holds, a line per array or fact
    mapping: str = ""  #: draft of a mapping; empty where none is needed or possible


def explain_file(path: str | Path, limit: int = LIMIT) -> Explanation:
    """Return what a file holds, with a draft of the mapping that imports it.

    It may be HDF5, gprMax, MATLAB, NPZ, CSV, Touchstone, SigMF, CPHD, NMEA, MCAP, a take of
    OptiTrack Motive or the recording of a commercial radar (:func:`flgpr.formats.read_gpr`).

    Parameters
    ----------
    path : path
        The file.
    limit : int
        Bytes that the file and an array may take.

    Returns
    -------
    Explanation
        What it holds.

    Raises
    ------
    ValueError
        If the file is damaged or of another kind.
    """
    path = existing(path)
    with path.open("rb") as file:
        head = file.read(64)
    if head.startswith(b"CPHD/"):
        return _explain_cphd(path)
    if re.match(rb"\s*\$[A-Z]{2}[A-Z]{3},", head):
        return _explain_nmea(path)
    if is_gpr(path):
        from flgpr.formats.gpr_import import explain_gpr

        kind, lines = explain_gpr(path, limit)
        return Explanation(path, kind, lines)
    opened = open_arrays(path, limit)
    if opened.kind == "HDF5 file" and is_gprmax(path):
        lines, mapping = explain_merged(path)
        return Explanation(path, "result of gprMax", lines or explain_gprmax(path), mapping)
    if opened.kind == "MCAP recording":
        # Its arrays are too many, and take too long, to read them all.
        return Explanation(path, opened.kind, opened.about + opened.notes, draft_of_file(opened))
    lines = opened.about + opened.notes
    lines += [_line(opened, info) for info in opened.arrays.values()]
    if opened.kind == "take of OptiTrack Motive":
        lines.append("read as a track: --track FILE --body NAME --axes x,-z,y")
        return Explanation(path, opened.kind, lines)
    return Explanation(path, opened.kind, lines, draft_of_file(opened))


def propose_mapping(path: str | Path, limit: int = LIMIT) -> str:
    """Draft the mapping that imports a file of named arrays.

    Parameters
    ----------
    path : path
        The file.
    limit : int
        Bytes that the file and an array may take.

    Returns
    -------
    str
        The mapping, TOML. What is a guess ends in a question mark, and an import refuses it until
        that is taken away.

    Raises
    ------
    ValueError
        If the file is damaged, needs no mapping, or holds no array that can be a signal.
    """
    explanation = explain_file(path, limit)
    if not explanation.mapping:
        if explanation.kind in _WITHOUT_MAPPING or is_gpr(explanation.path):
            raise ValueError(f"{path}: a {explanation.kind} is read without a mapping")
        raise ValueError(f"{path}: no array of this {explanation.kind} can be a signal")
    return explanation.mapping


def _explain_cphd(path: Path) -> Explanation:
    """Return what a CPHD file holds."""
    sarkit = optional("sarkit.cphd", "cphd")
    try:
        with path.open("rb") as file, sarkit.Reader(file) as reader:
            tree = reader.metadata.xmltree
        channels = tree.findall("{*}Data/{*}Channel")
        vectors = channels[0].findtext("{*}NumVectors")
        samples = channels[0].findtext("{*}NumSamples")
        domain = tree.findtext("{*}Global/{*}DomainType")
        low = float(tree.findtext("{*}Global/{*}FxBand/{*}FxMin")) / 1e9
        high = float(tree.findtext("{*}Global/{*}FxBand/{*}FxMax")) / 1e9
        polarizations = set()
        for parameters in tree.findall("{*}Channel/{*}Parameters"):
            transmit = parameters.findtext("{*}Polarization/{*}TxPol")
            receive = parameters.findtext("{*}Polarization/{*}RcvPol")
            polarizations.add(transmit + receive)
        collector = tree.findtext("{*}CollectionID/{*}CollectorName")
        is_ours = b"flgpr_tx_position" in optional("lxml.etree", "cphd").tostring(tree)
        anchor = "" if is_ours else "; an anchor is needed to place the lane"
        lines = [
            f"{len(channels)} channels of {vectors} vectors x {samples} samples, {domain} domain",
            f"{low:.4g} to {high:.4g} GHz, polarizations {', '.join(sorted(polarizations))}",
            f"collected by {collector}, read without a mapping{anchor}",
        ]
    except Exception as error:
        raise ValueError(
            f"{path}: cannot be read as CPHD: {' '.join(str(error).split())[:200]}"
        ) from None
    return Explanation(path, "CPHD file", lines)


def _explain_nmea(path: Path) -> Explanation:
    """Return how many sentences of each kind a log of NMEA 0183 holds."""
    kinds: Counter[str] = Counter()
    for line in read_named(path, MAX_MEMORY).splitlines():
        sentence = re.match(rb"\s*\$[A-Z]{2}([A-Z]{3}),", line)
        if sentence is not None:
            kinds[sentence[1].decode()] += 1
    counts = ", ".join(f"{count} {name}" for name, count in sorted(kinds.items()))
    needs = "GGA gives positions, HDT headings; read as a track with an anchor"
    return Explanation(path, "NMEA 0183 log", [counts, needs])


def _line(opened: ArrayFile, info: ArrayInfo) -> str:
    """Return in words what an array is, and where its values lie."""
    shape = " x ".join(map(str, info.shape)) or "one value"
    text = f"{info.name}: {shape} {info.dtype}"
    if info.unit:
        text += f" [{info.unit}]"
    if math.prod(info.shape) > SMALL:
        return text
    try:
        values = opened.read(info.name)
    except ValueError as error:
        return f"{text}, not read: {str(error).removeprefix(f'{opened.path}: ')}"
    if values.dtype.kind not in "fciu" or not values.size:
        return text
    is_complex = np.iscomplexobj(values)
    numbers = np.abs(values) if is_complex else values.astype(np.float64)
    finite = numbers[np.isfinite(numbers)]
    if finite.size:
        quantity = "magnitude " if is_complex else ""
        text += f", {quantity}{finite.min():.6g} to {finite.max():.6g}"
    bad = values.size - finite.size
    return text + (f", {bad} not finite" if bad else "")
