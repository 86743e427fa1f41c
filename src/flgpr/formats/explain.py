"""What a file holds, in words, and a first draft of the mapping that imports it. Guesses end in a question mark."""

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
from flgpr.formats.gprmax import explain_gprmax, explain_merged, is_gprmax
from flgpr.store.extras import optional
from flgpr.store.files import existing
from flgpr.store.store_layout import MAX_MEMORY


@dataclass(frozen=True)
class Explanation:
    """What a file holds."""

    path: Path
    kind: str
    lines: list[str] = field(default_factory=list)  #: what it holds, a line per array or fact
    mapping: str = ""  #: draft of a mapping; empty where none is needed or possible


def explain_file(path: str | Path, limit: int = LIMIT) -> Explanation:
    """Tell what a file holds and draft the mapping that imports it; file and arrays may take ``limit`` bytes.

    It may be HDF5, gprMax, MATLAB, NPZ, CSV, Touchstone, CPHD, NMEA, MCAP, a take of OptiTrack Motive or the recording
    of a commercial radar (:func:`flgpr.formats.read_gpr`); another or damaged one is a ValueError.
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

        return Explanation(path, *explain_gpr(path, limit))
    opened = open_arrays(path, limit)
    if opened.kind == "HDF5 file" and is_gprmax(path):
        lines, mapping = explain_merged(path)
        return Explanation(path, "result of gprMax", lines or explain_gprmax(path), mapping)
    if (
        opened.kind == "MCAP recording"
    ):  # whose arrays are too many, and take too long, to look at all
        return Explanation(path, opened.kind, opened.about + opened.notes, draft_of_file(opened))
    lines = opened.about + opened.notes + [_line(opened, info) for info in opened.arrays.values()]
    if opened.kind == "take of OptiTrack Motive":
        return Explanation(
            path, opened.kind, [*lines, "read as a track: --track FILE --body NAME --axes x,-z,y"]
        )
    return Explanation(path, opened.kind, lines, draft_of_file(opened))


def propose_mapping(path: str | Path, limit: int = LIMIT) -> str:
    """Draft the mapping (TOML) that imports a file of named arrays.

    What is a guess ends in a question mark, and an import refuses it until that is taken away. A file that needs no
    mapping is a ValueError.
    """
    explanation = explain_file(path, limit)
    if not explanation.mapping:
        raise ValueError(f"{path}: a {explanation.kind} is read without a mapping")
    return explanation.mapping


def _explain_cphd(path: Path) -> Explanation:
    sarkit = optional("sarkit.cphd", "cphd")
    try:
        with path.open("rb") as file, sarkit.Reader(file) as reader:
            tree = reader.metadata.xmltree
        channels = tree.findall("{*}Data/{*}Channel")
        first = channels[0]
        band = [
            float(tree.findtext(f"{{*}}Global/{{*}}FxBand/{{*}}{name}")) / 1e9
            for name in ("FxMin", "FxMax")
        ]
        polarizations = {
            one.findtext("{*}Polarization/{*}TxPol") + one.findtext("{*}Polarization/{*}RcvPol")
            for one in tree.findall("{*}Channel/{*}Parameters")
        }
        own = b"flgpr_tx_position" in optional("lxml.etree", "cphd").tostring(tree)
        lines = [
            f"{len(channels)} channels of {first.findtext('{*}NumVectors')} vectors x "
            f"{first.findtext('{*}NumSamples')} samples, {tree.findtext('{*}Global/{*}DomainType')} domain",
            f"{band[0]:.4g} to {band[1]:.4g} GHz, polarizations {', '.join(sorted(polarizations))}",
            f"collected by {tree.findtext('{*}CollectionID/{*}CollectorName')}, read without a mapping"
            + ("" if own else "; an anchor is needed to place the lane"),
        ]
    except Exception as error:
        raise ValueError(
            f"{path}: cannot be read as CPHD: {' '.join(str(error).split())[:200]}"
        ) from None
    return Explanation(path, "CPHD file", lines)


def _explain_nmea(path: Path) -> Explanation:
    found = (
        re.match(rb"\s*\$[A-Z]{2}([A-Z]{3}),", line)
        for line in read_named(path, MAX_MEMORY).splitlines()
    )
    kinds = Counter(sentence[1].decode() for sentence in found if sentence)
    counts = ", ".join(f"{count} {name}" for name, count in sorted(kinds.items()))
    needs = "GGA gives positions, HDT headings; read as a track with an anchor"
    return Explanation(path, "NMEA 0183 log", [counts, needs])


def _line(opened: ArrayFile, info: ArrayInfo) -> str:
    shape = " x ".join(map(str, info.shape)) or "one value"
    text = f"{info.name}: {shape} {info.dtype}" + (f" [{info.unit}]" if info.unit else "")
    try:
        values = opened.read(info.name) if math.prod(info.shape) <= SMALL else None
    except ValueError as error:
        return f"{text}, not read: {str(error).removeprefix(f'{opened.path}: ')}"
    if values is None or values.dtype.kind not in "fciu" or not values.size:
        return text
    size = np.abs(values) if np.iscomplexobj(values) else values.astype(np.float64)
    good = size[np.isfinite(size)]
    bad = values.size - good.size
    what = "magnitude " if np.iscomplexobj(values) else ""
    span = f", {what}{good.min():.6g} to {good.max():.6g}" if good.size else ""
    return text + span + (f", {bad} not finite" if bad else "")
