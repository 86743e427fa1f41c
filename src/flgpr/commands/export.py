"""``flgpr export``: write alarms, truth, run-views or runs for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Option

from flgpr.commands.exports import Wish, export_formats, write_export
from flgpr.commands.options import AnchorOption, Output, PathLike
from flgpr.commands.shell import command


@command()
def export(
    source: PathLike,
    output: Output,
    to: Annotated[str, Option(help=f"One of {', '.join(export_formats())}.")],
    anchor: AnchorOption = None,
    kind: str | None = None,
    time: str | None = None,
    detection: str | None = None,
    score: PathLike | None = None,
    columns: str | None = None,
    organisation: str | None = None,
) -> Path:
    """Write alarms, truth, run-views or runs for other programs, on the Earth.

    A recording of a result or a live run (mcap), or of a run (sigmf), needs no place on the Earth.
    The output of sigmf is a folder.

    Parameters
    ----------
    source
        Result folder, truth or alarm table (CSV), run store (for cphd and sigmf), or folder of a
        live run (for mcap).
    kind
        What a table holds: truth (default), alarms or objects.
    time
        Time of the observation (ISO 8601), kept with every point.
    detection
        Detection of a result: main (default) or a variant.
    score
        Folder of the result's score, whose truth goes on qgis's map.
    columns
        Columns of a table that have other names: x=Rechts,y=Hoch.
    organisation
        With imsma: organisation that made the survey.
    anchor
        needed where the data have no georeference

    Returns
    -------
    pathlib.Path
        The file or folder that was written.

    Raises
    ------
    ValueError
        If the format is not known, an option does not go with it, or the lane has no
        georeference.
    FileExistsError
        If another file is at the output.
    """
    wish = Wish(source, output, to, anchor, kind, time, detection, score, columns, organisation)
    return write_export(wish)
