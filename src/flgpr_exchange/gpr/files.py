"""Files of commercial ground-penetrating radars: one line of traces, with what its headers say.

A reader of a format takes a path, the most bytes to use, and a list that gets a note of all that it
leaves out, replaces or assumes. It returns entries of a :class:`~flgpr.formats.section.GprSection`,
of which "fixes" are :class:`~flgpr_exchange.gpr.positions.Fixes`. Each maker's layout is described
in the module of its reader.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from flgpr.formats.array_file import faults_of_parser
from flgpr.formats.section import GprSection
from flgpr.model.printable import printable
from flgpr.store.files import existing
from flgpr.store.store_layout import MAX_MEMORY
from flgpr.types import Entries, Notes
from flgpr_exchange.gpr.dt1 import read_dt1
from flgpr_exchange.gpr.dzt import read_dzt
from flgpr_exchange.gpr.ids import read_ids
from flgpr_exchange.gpr.mala import read_mala
from flgpr_exchange.gpr.ogpr import read_ogpr
from flgpr_exchange.gpr.parts import MissingHeaderError
from flgpr_exchange.gpr.positions import Fixes
from flgpr_exchange.gpr.segy import read_segy, read_su

NOT_READ = {
    ".gpz": (
        "GPZ",
        "a project of pulseEKKO is a zip of DT1 and HD files: unzip it, and give a DT1 file",
    ),
    ".3dra": ("3d-radar", "its layout is not published; export SEG-Y from the maker's Examiner"),
    ".sg2": ("SEG-2", "there is no reader for it; export SEG-Y from the recorder's program"),
    ".gsf": ("Geoscanners", "there is no reader for it; export SEG-Y from the maker's GPRSoft"),
}
"""Endings of recordings that are known and cannot be read: what they are, and what to do."""


def read_gpr(path: str | Path, max_memory: int = MAX_MEMORY) -> GprSection:
    """Read a line of traces of a commercial radar.

    The ending, of any case, states the format: Sensors & Software (``.dt1``), GSSI (``.dzt``), MALÅ
    (``.rd3``, ``.rd7``), ImpulseRadar (``.iprb``), IDS (``.dt``), SEG-Y (``.sgy``, ``.segy``,
    ``.seg``), Seismic Unix (``.su``) or OpenGPR (``.ogpr``). Headers, positions and marks (``.hd``, ``.gps``,
    ``.gp2``, ``.dzg``, ``.dzx``, ``.rad``, ``.iprh``, ``.cor``) lie beside it under the same name.

    Parameters
    ----------
    path : path
        The recording.
    max_memory : int
        Bytes of memory to use.

    Returns
    -------
    GprSection
        The line. What is left out, replaced or assumed is counted in ``history``, as is damage in a
        file of positions or marks.

    Raises
    ------
    FileNotFoundError
        If a header is missing.
    ValueError
        If a header contradicts the file's size, holds nonsense, or asks for more memory.
    """
    path = existing(path)
    suffix = path.suffix.lower()
    if suffix in NOT_READ:
        kind, advice = NOT_READ[suffix]
        raise ValueError(f"{path}: {kind} files cannot be read: {advice}")
    if suffix in _BESIDE:
        what, recording = _BESIDE[suffix]
        raise ValueError(f"{path}: this {what}; give the {recording} file beside it")
    if suffix not in READERS:
        raise ValueError(f"{path}: the ending must be one of {', '.join(READERS)}, got {suffix!r}")
    format_name, reader = READERS[suffix]
    notes: Notes = []
    with faults_of_parser(path, format_name, (MissingHeaderError,)):
        entries = reader(path, max_memory, notes)
    if entries.get("gather"):
        notes.append(f"its antennas move apart ({entries['gather']}): it is no line of one offset")
    fixes: Fixes = entries.pop("fixes", Fixes())
    entries["title"] = entries.get("title") or printable(path.stem)
    entries |= {"fixes": fixes.table, "fix_time": fixes.time, "history": tuple(notes)}
    return GprSection(path, format_name, **entries, max_memory=max_memory)


def is_gpr(path: Path) -> bool:
    """Return whether the ending of a file is that of a commercial radar's recording.

    Endings of files that lie beside a recording count, too.

    Parameters
    ----------
    path : Path
        The file, which is not opened.

    Returns
    -------
    bool
        Whether it is one.
    """
    return path.suffix.lower() in {**READERS, **NOT_READ, **_BESIDE}


READERS: dict[str, tuple[str, Callable[[Path, int, list[str]], Entries]]] = {
    ".dt1": ("Sensors & Software DT1", read_dt1),
    ".dzt": ("GSSI DZT", read_dzt),
    ".rd3": ("MALÅ RD3", read_mala),
    ".rd7": ("MALÅ RD7", read_mala),
    ".iprb": ("ImpulseRadar IPRB", read_mala),
    ".dt": ("IDS DT", read_ids),
    ".sgy": ("SEG-Y", read_segy),
    ".segy": ("SEG-Y", read_segy),
    ".seg": ("SEG-Y", read_segy),
    ".su": ("Seismic Unix", read_su),
    ".ogpr": ("OpenGPR", read_ogpr),
}
"""What each ending is, and how it is read."""
_HEADER = "is the header of a recording"
_COMPANION = "lies beside a recording and is read with it"
_BESIDE = {
    ".hd": (_HEADER, ".dt1"),
    ".rad": (_HEADER, ".rd3 or .rd7"),
    ".iprh": (_HEADER, ".iprb"),
    ".gps": (_COMPANION, ".dt1"),
    ".gp2": (_COMPANION, ".dt1"),
    ".dzg": (_COMPANION, ".dzt"),
    ".dzx": (_COMPANION, ".dzt"),
    ".cor": (_COMPANION, ".rd3, .rd7 or .iprb"),
    ".mrk": (_COMPANION, ".rd3, .rd7 or .iprb"),
}
"""Endings of files beside a recording: what they are, and the recording's own."""
