"""Files of commercial ground-penetrating radars: one line of traces, with what its headers say.

A reader of a format takes a path and the most bytes to use, and returns the entries of a
:class:`~flgpr.formats.section.GprSection`. What it leaves out, replaces or assumes it says in ``history``. Each maker's
layout is described in the module of its reader.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from flgpr.formats.section import GprSection
from flgpr.model.printable import printable
from flgpr.store.files import existing
from flgpr.store.store_layout import MAX_MEMORY
from flgpr_exchange.gpr.dt1 import read_dt1
from flgpr_exchange.gpr.dzt import read_dzt
from flgpr_exchange.gpr.ids import read_ids
from flgpr_exchange.gpr.mala import read_impulse, read_mala
from flgpr_exchange.gpr.ogpr import read_ogpr
from flgpr_exchange.gpr.parts import MissingHeaderError
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
    if suffix in _HEADERS:
        raise ValueError(
            f"{path}: this is the header of a recording; give the {_HEADERS[suffix]} file beside it"
        )
    if suffix in _COMPANIONS:
        raise ValueError(
            f"{path}: this lies beside a recording and is read with it; "
            f"give the {_COMPANIONS[suffix]} file beside it"
        )
    if suffix not in READERS:
        raise ValueError(f"{path}: the ending must be one of {', '.join(READERS)}, got {suffix!r}")
    format_name, reader = READERS[suffix]
    try:
        entries = reader(path, max_memory)
    except MissingHeaderError:
        raise
    except Exception as error:
        message = " ".join(str(error).split())[:240] or type(error).__name__
        raise ValueError(f"{path}: cannot be read as {format_name}: {message}") from None
    defaults: dict[str, Any] = {"title": printable(path.stem), "max_memory": max_memory}
    return GprSection(path, format_name, **(defaults | entries))


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
    return path.suffix.lower() in {**READERS, **NOT_READ, **_HEADERS, **_COMPANIONS}


READERS: dict[str, tuple[str, Callable[[Path, int], dict[str, Any]]]] = {
    ".dt1": ("Sensors & Software DT1", read_dt1),
    ".dzt": ("GSSI DZT", read_dzt),
    ".rd3": ("MALÅ RD3", read_mala),
    ".rd7": ("MALÅ RD7", read_mala),
    ".iprb": ("ImpulseRadar IPRB", read_impulse),
    ".dt": ("IDS DT", read_ids),
    ".sgy": ("SEG-Y", read_segy),
    ".segy": ("SEG-Y", read_segy),
    ".seg": ("SEG-Y", read_segy),
    ".su": ("Seismic Unix", read_su),
    ".ogpr": ("OpenGPR", read_ogpr),
}
"""What each ending is, and how it is read."""
_COMPANIONS = {
    ".gps": ".dt1",
    ".gp2": ".dt1",
    ".dzg": ".dzt",
    ".dzx": ".dzt",
    ".cor": ".rd3, .rd7 or .iprb",
    ".mrk": ".rd3, .rd7 or .iprb",
}
"""Endings of positions and marks, and the recordings beside which they lie."""
_HEADERS = {".hd": ".dt1", ".rad": ".rd3 or .rd7", ".iprh": ".iprb"}
